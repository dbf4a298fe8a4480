//! Tracks of the suite: split, rules, and the played rows and missions.

use super::AgentVariant;
use avln_arena::Failure;
use avln_dataset::{Recipe, SceneChoice};
use avln_episode::{FeedbackRule, Rules};
use clap::ValueEnum;
use std::str::FromStr;

const SMALL_HOUSES: &str = include_str!("recipe.json");
/// Fewest missions of a row with a sample.
const SAMPLE: usize = 200;
/// Rows with all missions of the main track.
const COMPLETE: [&str; 4] = ["random", "sound-follower", "pag-nav", "shortest-path"];
/// Rows of the hard track.
const HARD: [&str; 11] = [
    "random",
    "sound-follower",
    "pag-nav",
    "pag-nav-plus",
    "pag-nav-plus-no-gate",
    "pag-nav-plus-no-object-memory",
    "pag-nav-plus-no-search-sound",
    "pag-nav-plus-true-sight",
    HARD_ONLY[0],
    HARD_ONLY[1],
    "shortest-path",
];
/// Rows of no other track.
const HARD_ONLY: [&str; 2] =
    ["pag-nav-plus-true-sight-no-object-memory", "pag-nav-plus-true-sight-no-search-sound"];
/// Rows with feedback: agents with and without hearing.
const FEEDBACK: [&str; 4] = ["pag-nav", "pag-nav-no-audio", "pag-nav-plus", "pag-nav-plus-no-audio"];

/// A split with rules.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Track {
    /// Validation split of the recipe `paper`.
    #[default]
    Main,
    /// Missions of the main track with the rule set `lh-avln-hard-v1`.
    Hard,
    /// Small houses with a single storey.
    Quick,
}

/// The split's size, pool and seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SuiteSize {
    /// Houses.
    pub houses: u32,
    /// Missions per house.
    pub missions: usize,
    /// `true` for houses from the training pool, to tune agents.
    pub practice: bool,
    /// Seed for houses and missions; the recipe's by default.
    pub split_seed: Option<u64>,
}

impl SuiteSize {
    /// Returns the split's name in the recipe.
    pub(super) fn split(self) -> &'static str {
        if self.practice { "train" } else { "val" }
    }
}

impl Track {
    /// Rule set of the hard track.
    const HARD_RULES: &str = "lh-avln-hard-v1";

    /// Returns the name in results; practice houses are a track of their own.
    pub fn label(self, practice: bool) -> String {
        let name = match self {
            Self::Main => "main",
            Self::Hard => "hard",
            Self::Quick => "quick",
        };
        format!("{name}{}", if practice { "-practice" } else { "" })
    }

    /// Returns the default size: 550 missions in 11 houses, or 200 missions in 25 small houses.
    pub fn size(self) -> SuiteSize {
        let (houses, missions) = match self {
            Self::Main | Self::Hard => (11, 50),
            Self::Quick => (25, 8),
        };
        SuiteSize { houses, missions, practice: false, split_seed: None }
    }

    /// Returns the recipe of the only played split.
    pub(super) fn recipe(self, size: SuiteSize) -> Result<Recipe, Failure> {
        let text = match self {
            Self::Main | Self::Hard => Recipe::embedded("paper").unwrap_or(SMALL_HOUSES),
            Self::Quick => SMALL_HOUSES,
        };
        let mut recipe = Recipe::from_json(text)?;
        recipe.seed = size.split_seed.or(recipe.seed);
        recipe.splits.retain(|split| split.name == size.split());
        for split in &mut recipe.splits {
            split.missions_per_scene = size.missions;
            if let SceneChoice::Houses { count, .. } = &mut split.scenes {
                *count = size.houses;
            }
        }
        Ok(recipe)
    }

    /// Returns the rules on a split for `split_rules`; feedback is the rule set's by default.
    pub(super) fn rules(self, split_rules: Rules, feedback: Option<FeedbackRule>) -> Result<Rules, Failure> {
        let mut rules = match self {
            Self::Hard => Rules::named(Self::HARD_RULES).map_err(Failure::scene)?,
            Self::Main | Self::Quick => split_rules,
        };
        rules.feedback = feedback.unwrap_or(rules.feedback);
        Ok(rules)
    }

    /// Returns the rows in playing order, without the row for the user's models.
    pub fn rows(self, feedback: Option<FeedbackRule>) -> Vec<AgentVariant> {
        let is_row = |variant: &AgentVariant| {
            let name = variant.name();
            match (self, feedback) {
                (_, Some(_)) => FEEDBACK.contains(&name.as_str()),
                (Self::Hard, None) => HARD.contains(&name.as_str()),
                (Self::Main | Self::Quick, None) => {
                    *variant != AgentVariant::PagNavModels && !HARD_ONLY.contains(&name.as_str())
                }
            }
        };
        AgentVariant::value_variants().iter().copied().filter(is_row).collect()
    }

    /// Returns a row's missions: all, or the least sample with equal numbers from all houses.
    pub fn missions(self, variant: AgentVariant, size: SuiteSize, feedback: Option<FeedbackRule>) -> usize {
        let houses = size.houses as usize;
        let is_complete =
            self == Self::Main && feedback.is_none() && COMPLETE.contains(&variant.name().as_str());
        match self {
            _ if is_complete => houses * size.missions,
            Self::Quick => houses * size.missions,
            Self::Main | Self::Hard => houses * SAMPLE.div_ceil(houses.max(1)).min(size.missions),
        }
    }
}

/// Returns the name of a feedback rule in results.
pub(super) fn feedback_name(feedback: FeedbackRule) -> &'static str {
    match feedback {
        FeedbackRule::None => "none",
        FeedbackRule::Accepted => "accepted",
        FeedbackRule::Verdict => "verdict",
    }
}

/// A machine's part of the missions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SuiteShard {
    /// Part, from 1.
    pub part: usize,
    /// Parts.
    pub parts: usize,
}

impl Default for SuiteShard {
    /// Returns the only part of an undivided suite.
    fn default() -> Self {
        Self { part: 1, parts: 1 }
    }
}

impl SuiteShard {
    /// Returns `true` if the part includes a mission; houses are spread over all parts.
    pub(super) fn includes(self, mission: usize) -> bool {
        mission % self.parts == self.part - 1
    }
}

impl FromStr for SuiteShard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers =
            text.split_once('/').and_then(|(part, parts)| Some((part.parse().ok()?, parts.parse().ok()?)));
        match numbers {
            Some((part, parts)) if (1..=parts).contains(&part) => Ok(Self { part, parts }),
            _ => Err(format!("'{text}' is no part; use I/N with I from 1 to N, such as 1/2")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_have_equal_numbers_from_all_houses() {
        let size = Track::Main.size();
        let missions = |track: Track, name: &str, feedback| {
            track.missions(AgentVariant::from_str(name, false).expect("a row"), size, feedback)
        };
        for name in COMPLETE {
            assert_eq!(missions(Track::Main, name, None), 550, "{name}");
        }
        assert_eq!(missions(Track::Main, "frontier", None), 11 * 19);
        assert_eq!(missions(Track::Hard, "pag-nav", None), 11 * 19);
        assert_eq!(missions(Track::Main, "pag-nav", Some(FeedbackRule::Verdict)), 11 * 19);
        let small = SuiteSize { missions: 2, ..size };
        assert_eq!(Track::Main.missions(AgentVariant::Frontier, small, None), 22);
    }

    #[test]
    fn shards_divide_the_missions() {
        for parts in [1, 2, 3] {
            for mission in 0..20 {
                let owners = (1..=parts).filter(|&part| SuiteShard { part, parts }.includes(mission));
                assert_eq!(owners.count(), 1);
            }
        }
        assert_eq!("2/3".parse(), Ok(SuiteShard { part: 2, parts: 3 }));
        for wrong in ["0/2", "3/2", "1", "1/x", "/"] {
            assert!(wrong.parse::<SuiteShard>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn main_split_is_that_of_the_paper_recipe() {
        let whole = Recipe::embedded("paper").expect("the recipe");
        let whole = Recipe::from_json(whole).expect("a recipe");
        let played = Track::Main.recipe(Track::Main.size()).expect("a recipe");
        let val = whole.splits.iter().find(|split| split.name == "val").expect("a split");
        assert_eq!((&played.splits[..], &played.name), (std::slice::from_ref(val), &whole.name));
        assert_eq!(Track::Hard.recipe(Track::Hard.size()).expect("a recipe"), played);

        let fresh = SuiteSize { split_seed: Some(5), ..Track::Main.size() };
        let fresh = Track::Main.recipe(fresh).expect("a recipe");
        assert_eq!(fresh, Recipe { seed: Some(5), ..played });
    }

    #[test]
    fn feedback_rows_are_pairs_with_and_without_audio() {
        let rows = Track::Main.rows(Some(FeedbackRule::Verdict));
        assert!(rows.iter().any(|row| row.hears()) && rows.iter().any(|row| !row.hears()), "{rows:?}");
        assert!(Track::Hard.rows(None).contains(&AgentVariant::SoundFollower));
        let rows = Track::Main.rows(None);
        let others = AgentVariant::value_variants().iter().filter(|variant| !rows.contains(variant));
        let others: Vec<_> = others.map(|variant| variant.name()).collect();
        assert_eq!(others, [&["pag-nav-models"][..], &HARD_ONLY].concat());
        assert_eq!(Track::Hard.rows(None).len(), HARD.len());
    }
}
