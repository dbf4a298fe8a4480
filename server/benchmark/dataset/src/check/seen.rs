use crate::{
    Description, SurveyOptions, ThresholdsOnly, View,
    describe::{Facts, fits_only},
    picture,
    survey::{Palette, Sighting, look_around},
};
use avln_episode::Rules;
use avln_scene::InstanceId;
use avln_world::SceneAssets;
use std::collections::BTreeMap;

/// What was seen when the looks of the survey were taken again.
pub(super) struct Seen<'a> {
    assets: &'a SceneAssets,
    options: &'a SurveyOptions,
    sightings: Vec<Sighting>,
    palettes: BTreeMap<InstanceId, Palette>,
}

impl<'a> Seen<'a> {
    pub(super) fn of(assets: &'a SceneAssets, rules: &Rules, options: &'a SurveyOptions) -> Self {
        let (sightings, palettes) = look_around(assets, rules, options, &ThresholdsOnly);
        Self { assets, options, sightings, palettes }
    }

    /// What is wrong with a sentence that was said of `instance`.
    pub(super) fn sentence(&self, instance: u32, said: &Description) -> Option<String> {
        let Some(claims) = &said.claims else {
            return Some("the description comes without its claims".to_owned());
        };
        let facts = Facts::new(self.assets, &self.palettes);
        let index = self.assets.scene.objects.iter().position(|object| object.id.0 == instance)?;
        let fits = fits_only(&facts, claims, index);
        (!fits).then(|| format!("'{}' does not fit instance {instance} alone", said.text))
    }

    /// What is wrong with a picture that was taken of `instance`.
    pub(super) fn picture(&self, instance: u32, view: &View) -> Option<String> {
        let objects = &self.assets.scene.objects;
        let sighting = self.sightings.iter().find(|sighting| objects[sighting.index].id.0 == instance);
        let known = sighting.is_some_and(|sighting| {
            picture::choose(&self.assets.scene, sighting, &self.sightings, self.options).0.contains(view)
        });
        (!known).then(|| format!("the picture does not tell instance {instance} from others of its kind"))
    }
}
