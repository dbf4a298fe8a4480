//! The oracle knows everything, follows the shortest tour through the real protocol, and must succeed: this proves
//! that every mission can be solved and that rules, references and regions agree with each other.

use avln_client::{Action, Arena, Order, RunOptions, Sensors};
use avln_server::arena::{data::DataFolder, register};
use avln_tests::{
    House, PHASE, Plan,
    walk::{PASSED_M, Place, Walker, distance_m},
};
use avln_truth::{EpisodeTruth, Target};

/// The corner of the reference tour that lies in the region of goal `goal`.
fn tour_corner(truth: &EpisodeTruth, goal: usize) -> Option<usize> {
    let region = &truth.targets[goal].region;
    let in_region =
        |corner: &Place| region.iter().any(|place| distance_m(*corner, [place.x, place.z]) < 1e-3);
    truth.reference_path.iter().map(|corner| [corner.x, corner.z]).position(|corner| in_region(&corner))
}

/// The goals in the order in which the reference tour visits them.
fn visits(truth: &EpisodeTruth) -> Vec<usize> {
    let mut goals: Vec<usize> = (0..truth.targets.len()).collect();
    if truth.order.as_str() == "unordered" {
        goals.sort_by_key(|&goal| tour_corner(truth, goal));
    }
    goals
}

/// Where the tour visits a goal; then, where that is not enough, the nearest place of its region that was not `tried`.
fn aim_of(truth: &EpisodeTruth, goal: usize, from: Place, tried: &mut Vec<(usize, Place)>) -> Place {
    let corner = tour_corner(truth, goal).map(|corner| truth.reference_path[corner]);
    let region = truth.targets[goal].region.iter();
    let places: Vec<Place> = corner.iter().chain(region).map(|place| [place.x, place.z]).collect();
    let passed = places.iter().filter(|place| distance_m(**place, from) < PASSED_M);
    tried.extend(passed.map(|place| (goal, *place)));
    let mut open = places.iter().copied().filter(|place| !tried.contains(&(goal, *place)));
    let corner = corner.map(|corner| [corner.x, corner.z]).filter(|corner| !tried.contains(&(goal, *corner)));
    let nearest = |a: &Place, b: &Place| distance_m(*a, from).total_cmp(&distance_m(*b, from));
    corner.or_else(|| open.by_ref().min_by(nearest)).unwrap_or(places[0])
}

async fn play(house: &House, order: Order) -> avln_client::RunSummary {
    let data = DataFolder::open(house.folder.path()).expect("the data folder");
    let split = data.split(PHASE).expect("its split");
    let rules = register::rules_of(PHASE, &data.missions(PHASE).expect("its files")).expect("its rules");
    let arena = Arena::connect(house.agents_url(), &house.token).await.expect("the door is open");
    let run = arena.start_run(RunOptions::new(PHASE, "oracle").order(order)).await.expect("a run");
    let blind = Sensors { rgb: false, depth: false, audio: false, ..Sensors::default() };
    let mut play = arena.play(&run, blind).await.expect("a stream");
    while let Some(mut episode) = play.next_episode().await.expect("an episode or the end") {
        let spec = &split.episodes[episode.ordinal() as usize - 1];
        let truth = spec
            .truth(if order == Order::Ordered { "ordered" } else { "unordered" }.parse().expect("an order"));
        let assets = split.scene(&spec.scene).expect("its scene").open(&rules).expect("it opens");
        let start = [truth.start.position.x, truth.start.position.z];
        let mut walker = Walker::new(start, truth.start.heading_rad);
        let mut open: Vec<usize> = (0..truth.targets.len()).collect();
        let visits = visits(&truth);
        let mut tried = Vec::new();
        while !episode.is_over() {
            let told = episode.observation().pose;
            let (place, _) = walker.locate(&told);
            let mut base = truth.start.position;
            (base.x, base.y, base.z) = (place[0], truth.start.position.y + told.position[1], place[1]);
            let candidates = if order == Order::Ordered { &open[..1] } else { &open[..] };
            let reached = candidates.iter().copied().filter_map(|goal| {
                let target: &Target = &truth.targets[goal];
                let object = assets.scene.objects.iter().find(|object| object.id.0 == target.instance)?;
                let sees = |eye: &_, half_view_rad| assets.sees(eye, object.id, half_view_rad);
                Some((target.distance_within_region(&base, &rules, sees)?, goal))
            });
            let here = reached.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, goal)| goal);
            let action = match here {
                Some(_) if open.len() == 1 => Action::Stop,
                Some(goal) => {
                    open.retain(|&other| other != goal);
                    Action::Submit
                }
                None => {
                    let goal = *visits.iter().find(|goal| open.contains(goal)).expect("a goal is open");
                    let aim = aim_of(&truth, goal, place, &mut tried);
                    let mut there = base;
                    (there.x, there.z) = (aim[0], aim[1]);
                    let ends =
                        [&base, &there].map(|end| assets.navmesh.snap(end, 0.5).expect("on the floor"));
                    let leg = assets.navmesh.path(&ends[0], &ends[1]).unwrap_or_default();
                    walker.step(&told, &leg.iter().map(|corner| [corner.x, corner.z]).collect::<Vec<_>>())
                }
            };
            episode.step(action).await.expect("a legal step");
        }
    }
    play.finish().await.expect("a summary")
}

async fn oracle_succeeds(order: Order) {
    let house = House::open(&Plan { houses: 3, missions: 4, ..Plan::default() }).await;
    let summary = play(&house, order).await;
    let value = |name: &str| {
        summary
            .metric(name)
            .map(|metric| metric.value)
            .unwrap_or_else(|| panic!("{name} is shown: {summary}"))
    };
    assert_eq!(value("sr"), 1.0, "{summary}");
    assert_eq!(value("osr"), 1.0, "{summary}");
    assert!(value("spl") > 0.9, "{summary}");
    house.doors.close().await.expect("both doors close");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_oracle_completes_every_ordered_mission_on_a_short_path() {
    oracle_succeeds(Order::Ordered).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_oracle_completes_every_unordered_mission_on_a_short_path() {
    oracle_succeeds(Order::Unordered).await;
}
