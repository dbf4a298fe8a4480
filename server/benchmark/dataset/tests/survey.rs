//! What a survey of a procedural house finds, looked at from outside.

use avln_dataset::{Instance, SurveyOptions, ThresholdsOnly, Verifier, View, survey_with};
use avln_episode::Rules;
use avln_formats::open::open;
use avln_houses::{HouseOptions, house};
use avln_scene::{InstanceId, Object};
use avln_world::{Body, Camera, Frame, SceneAssets};
use std::{path::Path, sync::LazyLock};

static ASSETS: LazyLock<SceneAssets> = LazyLock::new(|| {
    let rules = Rules::paper();
    let body = Body { radius_m: rules.body_radius_m, height_m: rules.body_height_m, ..Body::default() };
    let options = HouseOptions { rooms: 4..=5, ..HouseOptions::default() };
    SceneAssets::prepare(house("survey", 5, &options), &body).expect("a house can be lived in")
});

static FOUND: LazyLock<Vec<Instance>> = LazyLock::new(|| found(&ThresholdsOnly));

fn found(verifier: &dyn Verifier) -> Vec<Instance> {
    survey_with(&ASSETS, &Rules::paper(), &SurveyOptions::default(), verifier)
}

fn render(view: &View, side_px: u32) -> Frame {
    let rules = Rules::paper();
    let mut eye = view.pose.position;
    eye.y += rules.camera_height_m;
    ASSETS.render(&Camera {
        eye,
        world_from_camera: view.pose.rotation(),
        width: side_px,
        height: side_px,
        hfov_rad: view.hfov_rad,
        depth_max_m: rules.depth_max_m,
    })
}

#[test]
fn every_view_and_every_reference_picture_shows_its_instance() {
    assert!(FOUND.len() > 20, "{}", FOUND.len());
    for instance in FOUND.iter() {
        assert!((1..=6).contains(&instance.views.len()) && instance.images.len() <= 3);
        for view in instance.views.iter().chain(&instance.images) {
            let frame = render(view, 128);
            let own = frame.instances.iter().filter(|id| id.0 == instance.target.instance).count();
            assert!(own as f32 >= 0.005 * 128.0 * 128.0, "{} fills {own} pixels", instance.target.category);
        }
        let viewpoints: Vec<_> = instance.views.iter().map(|view| view.pose).collect();
        assert_eq!(viewpoints, instance.target.viewpoints);
    }
}

#[test]
fn margins_and_distractors_are_recorded() {
    for instance in FOUND.iter() {
        let category = &instance.target.category;
        let others = ASSETS.scene.objects.iter().filter(|object| object.category == *category).count() - 1;
        assert_eq!(usize::from(instance.distractors), others, "{category}");
        let range = if instance.images.is_empty() { 0.0..=0.0 } else { 0.35..=1.0 };
        assert!(range.contains(&instance.image_margin), "{category}: {}", instance.image_margin);
    }
    let with = |has: fn(&Instance) -> bool| FOUND.iter().filter(|instance| has(instance)).count();
    assert!(with(|instance| !instance.images.is_empty()) * 2 > FOUND.len());
    assert!(with(|instance| !instance.sentences.is_empty()) * 2 > FOUND.len());
}

#[test]
fn a_survey_can_be_repeated() {
    assert_eq!(found(&ThresholdsOnly), *FOUND);
}

/// Recognises things of one category.
struct Only(&'static str);

impl Verifier for Only {
    fn recognises(&self, frame: &Frame, object: &Object) -> bool {
        assert!(frame.instances.contains(&object.id) && object.id != InstanceId::NONE);
        object.category == self.0
    }
}

#[test]
fn a_verifier_has_the_last_word() {
    let category = FOUND[0].target.category.as_str();
    let only = found(&Only(category));
    assert!(only.iter().all(|instance| instance.target.category == category));
    let all = FOUND.iter().filter(|instance| instance.target.category == category).count();
    assert!(only.len() == all && all < FOUND.len());
}

#[test]
fn a_house_that_people_modelled_can_be_surveyed() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../../shared/scenes/aws_small_house/hm3d_style/00000-SmallHouse");
    if !path.exists() {
        println!("skipped: survey of a modelled house: needs ../shared/scenes");
        return;
    }
    let scene = open(&path).expect("a house in the layout of HM3D");
    let rules = Rules::paper();
    let body = Body { radius_m: rules.body_radius_m, height_m: rules.body_height_m, ..Body::default() };
    let assets = SceneAssets::prepare(scene, &body).expect("one can live in it");
    let instances = survey_with(&assets, &rules, &SurveyOptions::default(), &ThresholdsOnly);
    let sentences: Vec<&String> =
        instances.iter().flat_map(|instance| &instance.sentences).map(|sentence| &sentence.text).collect();
    assert!(instances.len() >= 10 && sentences.len() >= 10, "{} instances, {sentences:#?}", instances.len());
    assert!(sentences.iter().all(|text| !text.contains('_')), "{sentences:#?}");
}
