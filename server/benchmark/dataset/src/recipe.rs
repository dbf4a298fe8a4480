//! Recipes of data sets; seeds of splits: numbers for practice, secrets for hidden splits.

use crate::{
    error::DatasetError,
    mission::{MissionOptions, StepGoal},
    survey::{SurveyOptions, Verifier, VerifierId},
};
use avln_episode::Rules;
use avln_houses::Pool;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};
use std::{fmt, ops::RangeInclusive, path::PathBuf};

/// Recipe for a data set. Equal recipes give equal bytes on any thread count.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Data set name: 1 to 24 letters, digits, `-` and `_`; prefix for scenes and missions.
    pub name: String,
    /// Rule set name for regions and references.
    pub rules: String,
    /// Seed for all random draws; if absent, every split has a secret.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Mission constraints.
    pub missions: MissionRules,
    /// Survey thresholds.
    #[serde(default)]
    pub survey: SurveyOptions,
    /// Verifier of targets; none if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verifier: Option<VerifierId>,
    /// Splits in build order. Scenes are disjoint.
    pub splits: Vec<SplitRecipe>,
}

/// Mission constraints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MissionRules {
    /// Minimum and maximum goal count, 1 to 8, uniform.
    pub goals: [usize; 2],
    /// Least walking distance from the start to a success region, metres.
    pub min_start_m: f64,
    /// Least walking distance between two success regions of a mission, metres.
    pub min_separation_m: f64,
    /// Minimum and maximum distractor count in the scene, 0 to 255.
    pub distractors: [u8; 2],
    /// Wanted mission length; unconstrained if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<StepGoal>,
}

/// Recipe for a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitRecipe {
    /// Split name: 1 to 24 letters, digits, `-` and `_`.
    pub name: String,
    /// Scene source.
    pub scenes: SceneChoice,
    /// Missions per scene, 1 to 9999.
    pub missions_per_scene: usize,
    /// Mission constraints, if different.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub missions: Option<MissionRules>,
    /// Secret of a split without a seed; never in a recipe's file.
    #[serde(skip)]
    pub secret: Option<SplitSecret>,
}

/// Scene source of a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SceneChoice {
    /// Procedural houses.
    Houses {
        /// House count.
        count: u32,
        /// Minimum and maximum rooms.
        rooms: [u8; 2],
        /// Minimum and maximum storeys.
        storeys: [u8; 2],
        /// Furniture pool: `train`, `validation` or `test`.
        pool: String,
    },
    /// Files or folders.
    Files(Vec<PathBuf>),
}

impl Recipe {
    /// Embedded recipes by name.
    pub const EMBEDDED: [(&str, &str); 2] =
        [("paper", include_str!("../recipes/paper.json")), ("mini", include_str!("../recipes/mini.json"))];

    /// Returns an embedded recipe's JSON.
    pub fn embedded(name: &str) -> Option<&'static str> {
        Self::EMBEDDED.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
    }

    /// Most scenes per split.
    const MAX_SCENES: usize = 100_000;
    /// Most missions per scene: numbers have four digits.
    const MAX_MISSIONS: usize = 9_999;

    /// Parses a JSON recipe; an error if the JSON is invalid or a value is out of range.
    pub fn from_json(text: &str) -> Result<Self, DatasetError> {
        let recipe: Self = serde_json::from_str(text).map_err(|error| refused(format!("{error}")))?;
        recipe.check()?;
        Ok(recipe)
    }

    /// Returns the rule set; an error if this version has no such rule set.
    pub fn rules(&self) -> Result<Rules, DatasetError> {
        Rules::named(&self.rules).map_err(|error| refused(format!("`rules`: {error}")))
    }

    /// Returns the mission constraints for `split`.
    pub fn mission_rules<'a>(&'a self, split: &'a SplitRecipe) -> &'a MissionRules {
        split.missions.as_ref().unwrap_or(&self.missions)
    }

    /// Compares the recipe's verifier with `verifier`; an error names both.
    pub(crate) fn check_verifier(&self, verifier: &dyn Verifier) -> Result<(), DatasetError> {
        let found = verifier.id();
        require(self.verifier == found, || {
            let shown = |id: &Option<VerifierId>| {
                id.as_ref().map_or_else(|| "none".to_owned(), VerifierId::to_string)
            };
            format!("`verifier` is {}, but the build has {}", shown(&self.verifier), shown(&found))
        })
    }

    /// Checks all values; an error names the field, the value and the allowed range.
    pub fn check(&self) -> Result<(), DatasetError> {
        self.rules()?;
        check_name("name", &self.name)?;
        require(!self.splits.is_empty(), || "`splits` is empty; list at least one".to_owned())?;
        self.missions.check()?;
        self.survey.check().map_err(refused)?;
        for (index, split) in self.splits.iter().enumerate() {
            check_name("splits.name", &split.name)?;
            let is_new = self.splits[..index].iter().all(|other| other.name != split.name);
            require(is_new, || format!("two splits are called '{}'", split.name))?;
            limit("missions_per_scene", split.missions_per_scene, 1, Self::MAX_MISSIONS)?;
            limit("scenes", split.scene_count(), 1, Self::MAX_SCENES)?;
            split.scenes.check()?;
            split.missions.as_ref().map_or(Ok(()), MissionRules::check)?;
        }
        Ok(())
    }
}

impl Default for MissionRules {
    /// Two to four goals, at least 2 m from the start and 1 m apart.
    fn default() -> Self {
        let MissionOptions { goals, min_start_m, min_separation_m, distractors, steps, .. } =
            MissionOptions::new(0, 0);
        Self {
            goals: [*goals.start(), *goals.end()],
            min_start_m,
            min_separation_m,
            distractors: [*distractors.start(), *distractors.end()],
            steps,
        }
    }
}

impl SplitRecipe {
    /// Returns the scene count.
    pub fn scene_count(&self) -> usize {
        match &self.scenes {
            SceneChoice::Houses { count, .. } => *count as usize,
            SceneChoice::Files(files) => files.len(),
        }
    }
}

impl SceneChoice {
    fn check(&self) -> Result<(), DatasetError> {
        let Self::Houses { rooms, storeys, pool, .. } = self else { return Ok(()) };
        require(Pool::from_name(pool).is_some(), || {
            format!("`pool` is '{pool}'; use train, validation or test")
        })?;
        range("rooms", rooms.map(usize::from), 1, 64)?;
        range("storeys", storeys.map(usize::from), 1, 4)
    }
}

impl MissionRules {
    /// Returns the options for `episodes` missions.
    pub fn options(&self, episodes: usize, seed: u64) -> MissionOptions {
        MissionOptions {
            episodes,
            goals: self.goals[0]..=self.goals[1],
            min_start_m: self.min_start_m,
            min_separation_m: self.min_separation_m,
            distractors: self.distractor_range(),
            steps: self.steps,
            seed,
        }
    }

    /// Returns the allowed numbers of distractors.
    pub(crate) fn distractor_range(&self) -> RangeInclusive<u8> {
        self.distractors[0]..=self.distractors[1]
    }

    fn check(&self) -> Result<(), DatasetError> {
        range("goals", self.goals, 1, 8)?;
        range("distractors", self.distractors.map(usize::from), 0, 255)?;
        metres("min_start_m", self.min_start_m)?;
        metres("min_separation_m", self.min_separation_m)?;
        let Some(steps) = &self.steps else { return Ok(()) };
        let fits = (1.0..=1e6).contains(&steps.mean) && (0.0..=1.0).contains(&steps.spread);
        require(fits && (1..=1000).contains(&steps.draws), || {
            "`steps` needs a mean of 1 to 1000000, a spread of 0 to 1 and 1 to 1000 draws".to_owned()
        })
    }
}

fn refused(reason: String) -> DatasetError {
    DatasetError::Recipe(reason)
}

fn require(fits: bool, reason: impl FnOnce() -> String) -> Result<(), DatasetError> {
    if fits { Ok(()) } else { Err(refused(reason())) }
}

fn check_name(field: &str, name: &str) -> Result<(), DatasetError> {
    let fits = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
    require((1..=24).contains(&name.len()) && name.chars().all(fits), || {
        format!("`{field}` is '{}'; use 1 to 24 letters, digits, - and _", name.escape_debug())
    })
}

fn limit(field: &str, value: usize, least: usize, most: usize) -> Result<(), DatasetError> {
    require((least..=most).contains(&value), || {
        format!("`{field}` is {value}; {least} to {most} are possible")
    })
}

fn range(field: &str, [low, high]: [usize; 2], least: usize, most: usize) -> Result<(), DatasetError> {
    require(least <= low && low <= high && high <= most, || {
        format!("`{field}` is [{low}, {high}]; use [fewest, most] between {least} and {most}")
    })
}

fn metres(field: &str, value_m: f64) -> Result<(), DatasetError> {
    require((0.0..=1000.0).contains(&value_m), || {
        format!("`{field}` is {value_m}; 0 to 1000 metres are possible")
    })
}

/// Origin of all random draws for a split.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Seed {
    /// A number, for practice: anyone can make the same split.
    Number(u64),
    /// A secret, for hidden phases.
    Secret(SplitSecret),
}

/// 256 random bits, the key of all draws for a hidden split.
#[derive(Clone, PartialEq, Eq)]
pub struct SplitSecret([u8; 32]);

impl SplitSecret {
    /// Returns the secret with these random bits.
    pub fn new(random: [u8; 32]) -> Self {
        Self(random)
    }

    /// Returns 64 bits for a label, by keyed BLAKE3: labels are independent, and no result reveals the secret.
    pub fn word(&self, label: &[&str]) -> u64 {
        let mut hasher = blake3::Hasher::new_keyed(&self.0);
        for part in label {
            // Lengths keep ("ab", "c") and ("a", "bc") apart.
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
        }
        let [a, b, c, d, e, f, g, h, ..] = *hasher.finalize().as_bytes();
        u64::from_le_bytes([a, b, c, d, e, f, g, h])
    }
}

impl fmt::Debug for SplitSecret {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Secrets must not reach logs.
        formatter.write_str("SplitSecret")
    }
}

impl Serialize for SplitSecret {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl<'de> Deserialize<'de> for SplitSecret {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let hash = blake3::Hash::from_hex(String::deserialize(deserializer)?);
        let hash = hash.map_err(|_| D::Error::custom("a secret has 64 hexadecimal digits"))?;
        Ok(Self(*hash.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_are_written_as_hexadecimal_digits() {
        let secret = SplitSecret::new([0xa7; 32]);
        let json = serde_json::to_string(&secret).expect("JSON");
        assert_eq!(json, format!("\"{}\"", "a7".repeat(32)));
        assert_eq!(serde_json::from_str::<SplitSecret>(&json).expect("a secret"), secret);
        for wrong in ["\"a7\"", "7", "null"] {
            assert!(serde_json::from_str::<SplitSecret>(wrong).is_err(), "{wrong}");
        }
        assert_eq!(format!("{secret:?}"), "SplitSecret");
    }

    #[test]
    fn labels_and_secrets_separate_all_draws() {
        let [one, two] = [1, 2].map(|byte| SplitSecret::new([byte; 32]));
        let words =
            [one.word(&["ab", "c"]), one.word(&["a", "bc"]), one.word(&["abc"]), two.word(&["ab", "c"])];
        for (index, word) in words.iter().enumerate() {
            assert!(!words[index + 1..].contains(word), "{index}");
        }
    }
}
