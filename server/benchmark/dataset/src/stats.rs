//! The numbers of a data set: what is in it, and how it is spread.

mod page;
mod spread;

use crate::{
    cue::CueSpec,
    format::SceneFacts,
    mission::{EpisodeSpec, GoalSpec},
};
pub use page::{page, summary};
use serde::{Deserialize, Serialize};
pub use spread::Spread;
use std::collections::BTreeMap;

/// Counts over scenes and their missions; those of two sets of scenes add up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Statistics {
    /// Scenes.
    pub scenes: u64,
    /// Missions.
    pub missions: u64,
    /// Rooms of a scene.
    pub regions: Spread,
    /// Storeys of a scene, and how many scenes have so many.
    pub storeys: BTreeMap<u32, u64>,
    /// Walkable area of a scene, square metres.
    pub area_m2: Spread,
    /// Objects of a scene that can be targets.
    pub instances: Spread,
    /// Missions by number of goals.
    pub goals: BTreeMap<usize, u64>,
    /// Goals by modality.
    pub modalities: BTreeMap<String, u64>,
    /// Missions by the modalities of their goals, without order.
    pub mixes: BTreeMap<String, u64>,
    /// Goals by category of the target.
    pub categories: BTreeMap<String, u64>,
    /// Goals by other instances of the target's category in the scene.
    pub distractors: BTreeMap<u8, u64>,
    /// Targets by how many missions ask for them.
    pub uses: BTreeMap<u32, u64>,
    /// Length of the reference tour in the order of the goals, metres.
    pub ordered_m: Spread,
    /// The same in any order.
    pub unordered_m: Spread,
    /// Actions of the reference tour in the order of the goals.
    pub ordered_steps: Spread,
    /// The same in any order.
    pub unordered_steps: Spread,
    /// Walking distance from the start to a success region, metres.
    pub start_m: Spread,
    /// Words of a description.
    pub words: Spread,
}

impl Default for Statistics {
    fn default() -> Self {
        Self {
            scenes: 0,
            missions: 0,
            regions: Spread::new(2.0),
            storeys: BTreeMap::new(),
            area_m2: Spread::new(25.0),
            instances: Spread::new(10.0),
            goals: BTreeMap::new(),
            modalities: BTreeMap::new(),
            mixes: BTreeMap::new(),
            categories: BTreeMap::new(),
            distractors: BTreeMap::new(),
            uses: BTreeMap::new(),
            ordered_m: Spread::new(5.0),
            unordered_m: Spread::new(5.0),
            ordered_steps: Spread::new(25.0),
            unordered_steps: Spread::new(25.0),
            start_m: Spread::new(2.0),
            words: Spread::new(2.0),
        }
    }
}

impl Statistics {
    /// The numbers of one scene.
    pub fn of_scene(facts: Option<SceneFacts>, episodes: &[EpisodeSpec]) -> Self {
        let mut numbers = Self { scenes: 1, missions: episodes.len() as u64, ..Self::default() };
        if let Some(facts) = facts {
            numbers.regions.note(f64::from(facts.regions));
            *numbers.storeys.entry(facts.storeys).or_default() += 1;
            numbers.area_m2.note(facts.area_m2);
            numbers.instances.note(f64::from(facts.instances));
        }
        let mut uses: BTreeMap<u32, u32> = BTreeMap::new();
        for episode in episodes {
            numbers.note(episode);
            for goal in &episode.goals {
                *uses.entry(goal.target.instance).or_default() += 1;
            }
        }
        uses.into_values().for_each(|count| *numbers.uses.entry(count).or_default() += 1);
        numbers
    }

    fn note(&mut self, episode: &EpisodeSpec) {
        *self.goals.entry(episode.goals.len()).or_default() += 1;
        let mut mix: Vec<_> = episode.goals.iter().map(|goal| goal.cue.modality().as_str()).collect();
        mix.sort_unstable();
        *self.mixes.entry(mix.join(" + ")).or_default() += 1;
        self.ordered_m.note(episode.ordered.length_m);
        self.unordered_m.note(episode.unordered.length_m);
        self.ordered_steps.note(f64::from(episode.ordered.steps));
        self.unordered_steps.note(f64::from(episode.unordered.steps));
        episode.goals.iter().for_each(|goal| self.note_goal(goal));
    }

    fn note_goal(&mut self, goal: &GoalSpec) {
        *self.modalities.entry(goal.cue.modality().as_str().to_owned()).or_default() += 1;
        *self.categories.entry(goal.target.category.clone()).or_default() += 1;
        *self.distractors.entry(goal.distractors).or_default() += 1;
        self.start_m.note(goal.target.start_distance_m);
        if let CueSpec::Description(sentence) = &goal.cue {
            self.words.note(sentence.text.split_whitespace().count() as f64);
        }
    }

    /// Adds the numbers of other scenes.
    pub fn add(&mut self, other: &Self) {
        self.scenes += other.scenes;
        self.missions += other.missions;
        add(&mut self.storeys, &other.storeys);
        add(&mut self.goals, &other.goals);
        add(&mut self.modalities, &other.modalities);
        add(&mut self.mixes, &other.mixes);
        add(&mut self.categories, &other.categories);
        add(&mut self.distractors, &other.distractors);
        add(&mut self.uses, &other.uses);
        let theirs = [
            &other.regions,
            &other.area_m2,
            &other.instances,
            &other.ordered_m,
            &other.unordered_m,
            &other.ordered_steps,
            &other.unordered_steps,
            &other.start_m,
            &other.words,
        ];
        self.spreads().into_iter().zip(theirs).for_each(|(mine, theirs)| mine.add(theirs));
    }

    fn spreads(&mut self) -> [&mut Spread; 9] {
        [
            &mut self.regions,
            &mut self.area_m2,
            &mut self.instances,
            &mut self.ordered_m,
            &mut self.unordered_m,
            &mut self.ordered_steps,
            &mut self.unordered_steps,
            &mut self.start_m,
            &mut self.words,
        ]
    }

    /// Goals in all missions.
    pub fn goal_count(&self) -> u64 {
        self.modalities.values().sum()
    }

    /// Share of goals in a modality, 0 to 1.
    pub fn share(&self, modality: &str) -> f64 {
        self.modalities.get(modality).copied().unwrap_or(0) as f64 / self.goal_count().max(1) as f64
    }
}

fn add<K: Ord + Clone>(mine: &mut BTreeMap<K, u64>, theirs: &BTreeMap<K, u64>) {
    for (key, count) in theirs {
        *mine.entry(key.clone()).or_default() += count;
    }
}
