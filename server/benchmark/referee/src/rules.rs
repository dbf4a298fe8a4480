//! Parts of the rules: success regions, sound schedule, and world options.

use avln_episode::{self as episode, Action, DistanceRule, Rules, Sensors, SilenceRule, SoundingRule};
use avln_truth::Target;
use avln_world::{
    Camera, CameraView, DepthNoise, DistanceField, Head, InstanceId, Motion, NavPoint, Noise, Point3,
    RgbNoise, Rng, SceneAssets, World, WorldOptions,
};

/// Picture side for the pixel test in the authors' rule.
const LOOK_SIDE_PX: u32 = 128;
/// Largest snap distance from a stored point to the mesh, metres.
const SNAP_M: f32 = 0.5;

/// Test for success regions.
pub(crate) struct SuccessTest {
    rule: DistanceRule,
    /// Per target: walking distance to the success region.
    to_region: Vec<DistanceField>,
    /// Per target: walking distance to the viewpoints.
    to_viewpoint: Vec<DistanceField>,
}

impl SuccessTest {
    pub(crate) fn new(assets: &SceneAssets, targets: &[Target], rules: &Rules) -> Self {
        let field = |places: &mut dyn Iterator<Item = avln_episode::Point3<f32>>| {
            let seeds: Vec<(NavPoint, f64)> = places
                .filter_map(|place| assets.navmesh.snap(&place, SNAP_M))
                .map(|point| (point, 0.0))
                .collect();
            assets.navmesh.field(&seeds)
        };
        Self {
            rule: rules.success_distance,
            to_region: targets.iter().map(|t| field(&mut t.region.iter().copied())).collect(),
            to_viewpoint: targets
                .iter()
                .map(|t| field(&mut t.viewpoints.iter().map(|v| v.position)))
                .collect(),
        }
    }

    /// Returns the distance to `goal` by the rules' measure, if the body is in the success region.
    pub(crate) fn distance_within(
        &self,
        world: &World,
        goal: usize,
        target: &Target,
        rules: &Rules,
    ) -> Option<f64> {
        match self.rule {
            DistanceRule::CameraToBox | DistanceRule::CameraToMesh => {
                distance_within(world, InstanceId(target.instance), target, rules)
            }
            DistanceRule::BaseToViewpoint => {
                let distance_m =
                    self.to_viewpoint[goal].distance_m(&world.assets().navmesh, &world.standing())?;
                let near = distance_m < f64::from(rules.success_radius_m);
                (near && in_picture(world, target, rules)).then_some(distance_m)
            }
        }
    }

    /// Returns whether the body is within the success radius and in sight of another instance in the target's category.
    /// Measured from the camera under every rule set. Tests all instances, so that the time does not depend on the result.
    pub(crate) fn is_at_distractor(world: &World, target: &Target, rules: &Rules) -> bool {
        let assets = world.assets();
        let distractors =
            assets.scene.objects.iter().filter(|object| {
                object.category == target.category && object.id != InstanceId(target.instance)
            });
        distractors.fold(false, |is_there, object| {
            // Its floor is unknown. Anything visible within the radius is on the body's floor.
            let it = Target {
                bounds: object.bounds,
                floor_y_m: world.pose().position.y,
                region: Vec::new(),
                viewpoints: Vec::new(),
                category: String::new(),
                ..*target
            };
            let is_within = distance_within(world, object.id, &it, rules).is_some();
            is_there || is_within
        })
    }

    /// Returns the walking distance from the body to the goal's success region, metres.
    pub(crate) fn walk_m(&self, world: &World, goal: usize) -> Option<f64> {
        self.walk_from_m(world.assets(), &world.standing(), goal)
    }

    /// Returns the walking distance from a point to the goal's success region, metres.
    pub(crate) fn walk_from_m(&self, assets: &SceneAssets, point: &NavPoint, goal: usize) -> Option<f64> {
        self.to_region.get(goal)?.distance_m(&assets.navmesh, point)
    }

    /// Returns the corners of the shortest way from the body to the goal's success region.
    pub(crate) fn walk(&self, world: &World, goal: usize) -> Option<Vec<Point3<f32>>> {
        self.to_region.get(goal)?.path(&world.assets().navmesh, &world.standing())
    }
}

/// Returns the distance to a target with the mesh of `instance`, measured from the camera, if the body is in its success region.
fn distance_within(world: &World, instance: InstanceId, target: &Target, rules: &Rules) -> Option<f64> {
    let assets = world.assets();
    let to_mesh_m = |eye: &_| assets.distance_to_mesh_m(eye, instance);
    let sees = |eye: &_, half_view_rad| assets.sees(eye, instance, half_view_rad);
    target.distance_within_region(&world.pose().position, rules, to_mesh_m, sees)
}

fn in_picture(world: &World, target: &Target, rules: &Rules) -> bool {
    let camera = Camera {
        eye: world.eye(),
        world_from_camera: world.pose().rotation(),
        width: LOOK_SIDE_PX,
        height: LOOK_SIDE_PX,
        hfov_rad: 2.0 * Rules::HALF_VIEW_RAD,
        depth_max_m: rules.depth_max_m,
    };
    world.assets().render(&camera).instances.contains(&InstanceId(target.instance))
}

/// Fewest and most steps from a Submit to the silence of the found target under [`SilenceRule::Delayed`].
const DELAY_STEPS: (u32, u32) = (5, 20);

/// Sounding schedule over all sources, targets first: a function of seed, rules and completion steps.
#[derive(Clone, Debug)]
pub(crate) struct Schedule {
    turn: Turn,
    window_steps: u32,
    silence: Silence,
}

/// Silence of found targets.
#[derive(Clone, Debug)]
struct Silence {
    rule: SilenceRule,
    /// Steps from the completion to the silence per goal; empty unless delayed.
    delay_steps: Vec<u32>,
    /// Observations since the completion per source, 0 in the observation after the Submit; `None` for open goals and
    /// distractors.
    age: Vec<Option<u32>>,
}

impl Silence {
    fn new(rule: SilenceRule, goal_count: usize, source_count: usize, rng: &mut Rng) -> Self {
        let (least, most) = DELAY_STEPS;
        let delay = |_| least + rng.below((most - least + 1) as usize) as u32;
        let is_delayed = rule == SilenceRule::Delayed;
        let delay_steps = if is_delayed { (0..goal_count).map(delay).collect() } else { Vec::new() };
        Self { rule, delay_steps, age: vec![None; source_count] }
    }

    /// Counts an observation. Returns per source whether it is silent; `window` is the present one.
    fn next(&mut self, found: &[bool], window: Window) -> Vec<bool> {
        let ages = self.age.iter_mut().zip(found);
        ages.for_each(|(age, &found)| *age = found.then(|| age.map_or(0, |age| age + 1)));
        let is_silent = |(source, age): (usize, &Option<u32>)| match (self.rule, *age) {
            (_, None) => false,
            (SilenceRule::Immediate, Some(_)) => true,
            (SilenceRule::Delayed, Some(age)) => age >= self.delay_steps[source],
            // Not in the observation after the Submit, which would reveal the result if a window ends there.
            (SilenceRule::WindowEnd, Some(age)) => age > 0 && (source != window.source || window.has_ended),
        };
        self.age.iter().enumerate().map(is_silent).collect()
    }
}

/// Sounding window.
#[derive(Clone, Copy, Debug)]
struct Window {
    source: usize,
    has_ended: bool,
}

#[derive(Clone, Debug)]
enum Turn {
    /// Cycles through a drawn order; skips silent sources.
    Drawn { order: Vec<usize>, place: usize, steps_left: u32 },
    /// Cycles through all sources in order; counts only moves and turns.
    Goals { count: usize, moves: u32 },
}

impl Schedule {
    pub(crate) fn new(rules: &Rules, goal_count: usize, rng: &mut Rng) -> Self {
        let source_count = rules.sounding_sources(goal_count);
        let window_steps = rules.sounding_window_steps.max(1);
        let turn = match rules.sounding {
            SoundingRule::UnfinishedInDrawnOrder => {
                let mut order: Vec<_> = (0..source_count).collect();
                rng.shuffle(&mut order);
                Turn::Drawn { order, place: 0, steps_left: window_steps }
            }
            SoundingRule::AllInGoalOrder => Turn::Goals { count: source_count, moves: 0 },
        };
        // After the order, which is thus the same under every silence rule.
        let silence = Silence::new(rules.silence, goal_count, source_count, rng);
        Self { turn, window_steps, silence }
    }

    /// Returns the sounding source for the next observation; `None` if all are silent. `found` is by goal, `moved` true for
    /// moves and turns.
    pub(crate) fn next(&mut self, found: &[bool], moved: bool) -> Option<usize> {
        match &mut self.turn {
            Turn::Drawn { order, place, steps_left } => {
                let window = Window { source: order[*place], has_ended: *steps_left == 0 };
                let silent = self.silence.next(found, window);
                if silent.iter().all(|&silent| silent) {
                    return None;
                }
                if window.has_ended || silent[window.source] {
                    *place = next_place(order, *place, &silent);
                    *steps_left = self.window_steps;
                }
                *steps_left -= 1;
                Some(order[*place])
            }
            Turn::Goals { count, moves } => {
                *moves += u32::from(moved);
                Some((moves.saturating_sub(1) / self.window_steps) as usize % *count)
            }
        }
    }
}

/// Returns the next place in the cycle with a sounding source; at least one exists.
fn next_place(order: &[usize], place: usize, silent: &[bool]) -> usize {
    let cycle = (1..=order.len()).map(|ahead| (place + ahead) % order.len());
    cycle.into_iter().find(|&next| !silent[order[next]]).unwrap_or(place)
}

pub(crate) fn motion_of(action: Action) -> Motion {
    match action {
        Action::MoveForward => Motion::Forward,
        Action::TurnLeft => Motion::Left,
        Action::TurnRight => Motion::Right,
        Action::Submit | Action::Stop => Motion::Stay,
    }
}

pub(crate) fn world_options(rules: &Rules, sensors: &Sensors) -> WorldOptions {
    let view = CameraView { width: sensors.width, height: sensors.height, hfov_rad: sensors.hfov_rad };
    WorldOptions {
        forward_m: rules.forward_m,
        turn_deg: rules.turn_deg,
        camera_height_m: rules.camera_height_m,
        ear_height_m: rules.ear_height_m,
        depth_max_m: rules.depth_max_m,
        samples_per_step: rules.samples_per_step() as usize,
        view: (sensors.rgb || sensors.depth).then_some(view),
        audio: sensors.audio,
        head: Head::default(),
        noise: Noise::default(),
    }
}

pub(crate) fn noise(rules: &Rules, seed: u64) -> Noise {
    let depth = match rules.depth_noise {
        episode::DepthNoise::None => DepthNoise::None,
        episode::DepthNoise::Redwood => DepthNoise::Redwood,
    };
    let rgb = match rules.rgb_noise {
        episode::RgbNoise::None => RgbNoise::None,
        episode::RgbNoise::Gaussian => RgbNoise::Gaussian,
    };
    Noise { depth, rgb, seed }
}

pub(crate) fn scaled(mut depth: Vec<f32>, divisor: f32) -> Vec<f32> {
    if divisor != 1.0 {
        depth.iter_mut().for_each(|metres| *metres /= divisor);
    }
    depth
}

/// Appends silence per ear up to `length` samples.
pub(crate) fn padded(audio: &[f32], length: usize) -> Vec<f32> {
    let samples = audio.len() / Sensors::AUDIO_CHANNELS as usize;
    let mut out = vec![0.0; length.max(samples) * Sensors::AUDIO_CHANNELS as usize];
    for (ear, heard) in out.chunks_mut(length.max(samples)).zip(audio.chunks(samples.max(1))) {
        ear[..heard.len()].copy_from_slice(heard);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(rules: &Rules, silent_from: [u32; 3], steps: u32) -> Vec<usize> {
        let mut schedule = Schedule::new(rules, 3, &mut Rng::new(4));
        (0..steps).filter_map(|step| schedule.next(&silent_from.map(|from| step >= from), step > 0)).collect()
    }

    #[test]
    fn unfinished_targets_take_turns_of_one_window() {
        let heard = run(&Rules::paper(), [u32::MAX; 3], 150);
        let turns: Vec<_> = heard.chunks(25).map(|turn| turn[0]).collect();
        assert!(heard.chunks(25).all(|turn| turn.iter().all(|&target| target == turn[0])));
        assert_eq!(turns[..3], turns[3..]);
        let mut once = turns[..3].to_vec();
        once.sort_unstable();
        assert_eq!(once, [0, 1, 2]);
    }

    #[test]
    fn found_target_falls_silent_in_the_same_step() {
        let first = run(&Rules::paper(), [u32::MAX; 3], 1)[0];
        let mut silent_from = [u32::MAX; 3];
        silent_from[first] = 10;
        let heard = run(&Rules::paper(), silent_from, 200);
        assert!(heard[..10].iter().all(|&target| target == first));
        assert!(heard[10..].iter().all(|&target| target != first));
    }

    fn sounding(silence: SilenceRule, seed: u64, found_from: [u32; 3], steps: u32) -> Vec<Option<usize>> {
        let rules = Rules { silence, ..Rules::paper() };
        let mut schedule = Schedule::new(&rules, 3, &mut Rng::new(seed));
        (0..steps).map(|step| schedule.next(&found_from.map(|from| step >= from), step > 0)).collect()
    }

    #[test]
    fn later_silence_hides_results_in_the_next_step() {
        for rule in [SilenceRule::Delayed, SilenceRule::WindowEnd] {
            for (seed, found_at) in (0..4).flat_map(|seed| (1..110).map(move |step| (seed, step))) {
                let wrong = sounding(rule, seed, [u32::MAX; 3], 111);
                for goal in 0..3 {
                    let mut found_from = [u32::MAX; 3];
                    found_from[goal] = found_at;
                    let right = sounding(rule, seed, found_from, 111);
                    let seen = found_at as usize;
                    assert_eq!(right[..=seen], wrong[..=seen], "{rule:?}, goal {goal} at {found_at}");
                }
            }
        }
    }

    #[test]
    fn delayed_silence_follows_after_5_to_20_steps() {
        let mut delays = std::collections::BTreeSet::new();
        for seed in 0..200 {
            let heard = sounding(SilenceRule::Delayed, seed, [0; 3], 40);
            let silent_from = heard.iter().position(Option::is_none).expect("all are found");
            assert!(heard[silent_from..].iter().all(Option::is_none));
            delays.insert(silent_from);
        }
        assert!(delays.iter().all(|steps| (5..=20).contains(steps)) && delays.len() > 5, "{delays:?}");
    }

    #[test]
    fn window_end_silence_completes_the_window() {
        let all = sounding(SilenceRule::WindowEnd, 4, [u32::MAX; 3], 1)[0].expect("one sounds");
        let mut found_from = [u32::MAX; 3];
        found_from[all] = 10;
        let heard = sounding(SilenceRule::WindowEnd, 4, found_from, 200);
        assert!(heard[..25].iter().all(|&goal| goal == Some(all)), "the whole window");
        assert!(heard[25..].iter().all(|&goal| goal.is_some_and(|goal| goal != all)));
        let last = sounding(SilenceRule::WindowEnd, 4, [10; 3], 60);
        assert_eq!(last.iter().position(Option::is_none), Some(25));
    }

    #[test]
    fn silence_after_all_targets_are_found() {
        assert_eq!(run(&Rules::paper(), [5; 3], 30).len(), 5);
    }

    #[test]
    fn authors_schedule_switches_at_observation_26() {
        let heard = run(&Rules::authors(), [0; 3], 77);
        assert_eq!(heard, [vec![0; 26], vec![1; 25], vec![2; 25], vec![0]].concat());
    }

    /// Success rate for guessing the sounding target from the step number, learnt from other episodes; and the episode
    /// count.
    fn guessed(rules: &Rules) -> (f64, f64) {
        const EPISODES: u64 = 4000;
        const STEPS: usize = 300;
        let mut rng = Rng::new(8);
        let mut episode = |_| {
            let silent_from: [u32; 3] = std::array::from_fn(|_| rng.below(3 * STEPS) as u32);
            let mut schedule = Schedule::new(rules, 3, &mut Rng::new(rng.next_u64()).fork("schedule"));
            let next = |step| schedule.next(&silent_from.map(|from| step >= from), step > 0);
            (0..STEPS as u32).map(next).collect::<Vec<_>>()
        };
        let episodes: Vec<_> = (0..EPISODES).map(&mut episode).collect();
        let (known, unknown) = episodes.split_at(episodes.len() / 2);
        let count = |step: usize, goal| known.iter().filter(|heard| heard[step] == Some(goal)).count();
        let guesses: Vec<_> = (0..STEPS).map(|step| (0..3).max_by_key(|&goal| count(step, goal))).collect();
        let right = |step: usize| {
            unknown.iter().filter(|heard| heard[step].is_some() && heard[step] == guesses[step]).count()
        };
        let sounding = unknown.iter().flatten().flatten().count();
        ((0..STEPS).map(right).sum::<usize>() as f64 / sounding as f64, unknown.len() as f64)
    }

    #[test]
    fn step_number_reveals_no_sounding_target() {
        let (right, episodes) = guessed(&Rules::paper());
        let chance: f64 = 1.0 / 3.0;
        let deviation = (chance * (1.0 - chance) / episodes).sqrt();
        assert!(right <= chance + 3.0 * deviation, "{right} are right, {chance} by chance");
        let (right, _) = guessed(&Rules::authors());
        assert_eq!(right, 1.0, "this test sees a leak");
    }

    #[test]
    fn first_target_is_uniform() {
        let first = |seed| {
            Schedule::new(&Rules::paper(), 4, &mut Rng::new(seed).fork("schedule")).next(&[false; 4], false)
        };
        let mut counts = [0; 4];
        (0..4000).filter_map(first).for_each(|goal| counts[goal] += 1);
        // Three standard deviations of a draw of one in four.
        assert!(counts.iter().all(|count| (918..=1082).contains(count)), "{counts:?}");
    }

    /// Sounding sources under the hard rules with three goals, 0 to 2, and three distractors, 3 to 5.
    fn hard(seed: u64, found_from: [u32; 3], steps: u32) -> Vec<usize> {
        let mut schedule = Schedule::new(&Rules::hard(), 3, &mut Rng::new(seed).fork("schedule"));
        let mut next = |step| schedule.next(&found_from.map(|from| step >= from), step > 0);
        (0..steps).map(|step| next(step).expect("distractors sound forever")).collect()
    }

    #[test]
    fn step_number_does_not_distinguish_distractors() {
        const EPISODES: u32 = 4000;
        let mut targets = [0_u32; 6];
        for seed in 0..u64::from(EPISODES) {
            let turns: Vec<_> = hard(seed, [u32::MAX; 3], 150).chunks(25).map(|turn| turn[0]).collect();
            (0..6).for_each(|turn| targets[turn] += u32::from(turns[turn] < 3));
        }
        // Three standard deviations of a fair coin.
        let most = 3.0 * (f64::from(EPISODES) / 4.0).sqrt();
        let off = |count: &u32| (f64::from(*count) - f64::from(EPISODES) / 2.0).abs();
        assert!(targets.iter().all(|count| off(count) <= most), "targets by turn: {targets:?}");
    }

    #[test]
    fn distractors_sound_in_whole_turns_forever() {
        let mut rng = Rng::new(3);
        for seed in 0..100 {
            let found_from = std::array::from_fn(|_| rng.below(400) as u32);
            let (heard, open) = (hard(seed, found_from, 900), hard(seed, [u32::MAX; 3], 150));
            let turns: Vec<_> = heard.chunks(25).collect();
            assert!(turns.iter().all(|turn| turn.iter().all(|source| *source == turn[0])), "seed {seed}");
            let order: Vec<_> = open.chunks(25).map(|turn| turn[0]).filter(|&source| source > 2).collect();
            let last: Vec<_> = turns[turns.len() - 6..].iter().map(|turn| turn[0]).collect();
            assert!(last.iter().all(|&source| source > 2), "seed {seed}: {last:?}");
            let first = order.iter().position(|&source| source == last[0]).expect("a distractor");
            assert!((0..6).all(|turn| last[turn] == order[(first + turn) % 3]), "the drawn order continues");
        }
    }

    #[test]
    fn audio_is_padded_per_ear_and_never_cut() {
        let heard = [1.0, 2.0, 3.0, 4.0];
        assert_eq!(padded(&heard, 3), [1.0, 2.0, 0.0, 3.0, 4.0, 0.0]);
        assert_eq!(padded(&heard, 1), heard);
        assert_eq!(padded(&[], 2), [0.0; 4]);
    }

    #[test]
    fn depth_is_divided_by_the_divisor() {
        assert_eq!(scaled(vec![3.0, 0.0], 4.0), [0.75, 0.0]);
        assert_eq!(scaled(vec![3.0, 0.0], 1.0), [3.0, 0.0]);
    }
}
