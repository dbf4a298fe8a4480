//! Data set files read and validated, with limits.

use crate::{
    cue::{CueSpec, Description},
    error::FormatError,
    format::{
        DATASET_VERSION, Header, Manifest, PublicGoal, PublicMission, SceneLine, SealedGoal, SealedMission,
        SealedTarget, SecretFile, digest_of,
    },
    mission::{EpisodeSpec, GoalSpec},
};
use avln_episode::Modality;
use avln_truth::Target;
use serde::de::DeserializeOwned;
use std::collections::{BTreeMap, BTreeSet};

/// Most missions per scene.
const MAX_MISSIONS: usize = 100_000;
/// Most targets per scene.
const MAX_TARGETS: usize = 100_000;
/// Most goals per mission: the record has a bit per goal.
const MAX_GOALS: usize = 8;
/// Most scenes per split.
const MAX_SCENES: usize = 1_000_000;

/// File contents with a name for errors.
#[derive(Clone, Copy, Debug)]
pub struct File<'a> {
    /// Name in errors.
    pub name: &'a str,
    /// Contents.
    pub bytes: &'a [u8],
}

impl<'a> File<'a> {
    fn error(&self, line: Option<usize>, cause: String) -> FormatError {
        FormatError { file: self.name.to_owned(), line, cause }
    }

    /// Lines numbered from 1, without trailing empty ones.
    fn lines(&self) -> impl Iterator<Item = (usize, &'a [u8])> + use<'a> {
        let body = self.bytes.strip_suffix(b"\n").unwrap_or(self.bytes);
        let lines = body.split(|&byte| byte == b'\n').zip(1..).map(|(line, number)| (number, line));
        // `split` returns a single empty line for an empty file, which has none.
        lines.take(if body.is_empty() { 0 } else { usize::MAX })
    }

    fn parse<T: DeserializeOwned>(&self, (number, line): (usize, &[u8])) -> Result<T, FormatError> {
        serde_json::from_slice(line).map_err(|error| self.error(Some(number), json_error(&error)))
    }

    /// Parses a file with a single value.
    fn whole<T: DeserializeOwned>(&self) -> Result<T, FormatError> {
        serde_json::from_slice(self.bytes).map_err(|error| {
            let line = Some(error.line()).filter(|line| *line > 0);
            self.error(line, error.to_string())
        })
    }

    fn require(
        &self,
        holds: bool,
        line: Option<usize>,
        cause: impl FnOnce() -> String,
    ) -> Result<(), FormatError> {
        if holds { Ok(()) } else { Err(self.error(line, cause())) }
    }

    fn limit(&self, what: &str, found: usize, limit: usize) -> Result<(), FormatError> {
        self.require(found <= limit, None, || format!("{found} {what}, the limit is {limit}"))
    }

    fn finite(&self, line: usize, bad: finite::Bad) -> Result<(), FormatError> {
        bad.map_or(Ok(()), |what| Err(self.error(Some(line), finite::cause(what))))
    }

    fn header(&self, format: &str, scene: &str) -> Result<Header, FormatError> {
        let first = self.lines().next().ok_or_else(|| self.error(None, "the file is empty".to_owned()))?;
        let header: Header = self.parse(first)?;
        self.equal(&header.format, format, Some(1))?;
        self.version(header.version)?;
        self.equal(&header.scene, scene, Some(1))?;
        // Limits come before any allocation: a damaged header can promise anything.
        self.limit("missions", header.missions, MAX_MISSIONS)?;
        self.limit("targets", header.targets.unwrap_or(0), MAX_TARGETS)?;
        Ok(header)
    }

    /// Compares the file kind or scene.
    fn equal(&self, found: &str, expected: &str, line: Option<usize>) -> Result<(), FormatError> {
        self.require(found == expected, line, || {
            format!("found {found}, expected {expected}; was a file renamed?")
        })
    }

    fn version(&self, found: u32) -> Result<(), FormatError> {
        self.require(found == DATASET_VERSION, Some(1), || {
            format!(
                "version {found} is not supported, this program reads version {DATASET_VERSION}; rebuild the data set or update the program"
            )
        })
    }

    fn count(&self, what: &str, found: usize, promised: usize) -> Result<(), FormatError> {
        self.require(found == promised, None, || {
            format!(
                "{found} {what}, but the header promises {promised}; the file is truncated or was assembled by hand"
            )
        })
    }

    fn tied(&self, expected: &str) -> Result<(), FormatError> {
        let found = digest_of(self.bytes);
        self.require(found == expected, None, || digest_cause(&found, expected))
    }
}

fn digest_cause(found: &str, expected: &str) -> String {
    format!("digest {found}, but the scene list has {expected}; restore the file or rebuild it")
}

/// Parses `dataset.json`; an error if the JSON is invalid, or the version is unsupported.
pub fn read_manifest(file: File) -> Result<Manifest, FormatError> {
    let manifest: Manifest = file.whole()?;
    file.equal(&manifest.format, Manifest::FORMAT, None)?;
    file.version(manifest.version)?;
    Ok(manifest)
}

/// Parses `sealed/seed.json`; an error if it is invalid, or its recipe is.
pub fn read_secret(file: File) -> Result<SecretFile, FormatError> {
    let secret: SecretFile = file.whole()?;
    file.equal(&secret.format, SecretFile::FORMAT, None)?;
    file.version(secret.version)?;
    secret.recipe.check().map_err(|error| file.error(None, error.to_string()))?;
    Ok(secret)
}

/// Parses `scenes.jsonl`; an error if a line is invalid, a name occurs twice, or the digest is not `expected`.
pub fn read_scenes(file: File, expected: &str) -> Result<Vec<SceneLine>, FormatError> {
    let (mut scenes, mut names) = (Vec::new(), BTreeSet::new());
    for line in file.lines() {
        let scene: SceneLine = file.parse(line)?;
        let is_new = names.insert(scene.name.clone());
        file.require(is_new, Some(line.0), || format!("scene {} occurs twice", scene.name))?;
        file.finite(line.0, scene.facts.and_then(|facts| finite::number(facts.area_m2, "facts.area_m2")))?;
        scenes.push(scene);
        file.limit("scenes", scenes.len(), MAX_SCENES)?;
    }
    // The digest is checked last: a parse error names the line, a wrong digest only the file.
    file.tied(expected)?;
    Ok(scenes)
}

/// Parses the public missions file of `scene`; an error if it is truncated, invalid or belongs to another scene.
pub fn read_missions(file: File, scene: &str) -> Result<Vec<PublicMission>, FormatError> {
    let header = file.header(Header::MISSIONS, scene)?;
    let (mut missions, mut ids) = (Vec::new(), BTreeSet::new());
    for line in file.lines().skip(1) {
        let mission: PublicMission = file.parse(line)?;
        let is_new = ids.insert(mission.id.clone());
        file.require(is_new, Some(line.0), || format!("mission {} occurs twice", mission.id))?;
        file.finite(line.0, finite::pose(&mission.start, "start"))?;
        let goals = mission.goals.len();
        file.require((1..=MAX_GOALS).contains(&goals), Some(line.0), || {
            format!("{goals} goals, the limit is {MAX_GOALS}")
        })?;
        missions.push(mission);
        file.limit("missions", missions.len(), header.missions.max(1))?;
    }
    file.count("missions", missions.len(), header.missions)?;
    Ok(missions)
}

/// Joins both files of a scene; an error if one is truncated, invalid or has another digest, or both do not match.
pub fn read_scene(line: &SceneLine, missions: File, sealed: File) -> Result<Vec<EpisodeSpec>, FormatError> {
    let public = read_missions(missions, &line.name)?;
    missions.tied(&line.public)?;
    let header = sealed.header(Header::SEALED, &line.name)?;
    // The sealed file names the public file, so that files from two builds are not mixed.
    if header.public.as_deref() != Some(line.public.as_str()) {
        let cause = digest_cause(&header.public.unwrap_or_default(), &line.public);
        return Err(sealed.error(Some(1), cause));
    }
    let targets = read_targets(&sealed, header.targets.unwrap_or(0))?;
    let rest = sealed.lines().skip(1 + targets.len());
    let mut episodes = Vec::with_capacity(public.len());
    for (line_of, public) in rest.zip(&public) {
        let hidden: SealedMission = sealed.parse(line_of)?;
        let put = put_together(&line.name, public, hidden, &targets);
        episodes.push(put.map_err(|cause| sealed.error(Some(line_of.0), cause))?);
    }
    let found = sealed.lines().count().saturating_sub(1 + targets.len());
    sealed.count("missions", found, public.len())?;
    sealed.tied(&line.sealed)?;
    Ok(episodes)
}

fn read_targets(file: &File, count: usize) -> Result<BTreeMap<u32, SealedTarget>, FormatError> {
    let mut targets = BTreeMap::new();
    for line in file.lines().skip(1).take(count) {
        let sealed: SealedTarget = file.parse(line)?;
        file.finite(line.0, finite::target(&sealed.target))?;
        let id = sealed.target.instance;
        let is_new = targets.insert(id, sealed).is_none();
        file.require(is_new, Some(line.0), || format!("target {id} occurs twice"))?;
    }
    file.count("targets", targets.len(), count)?;
    Ok(targets)
}

fn put_together(
    scene: &str,
    public: &PublicMission,
    hidden: SealedMission,
    targets: &BTreeMap<u32, SealedTarget>,
) -> Result<EpisodeSpec, String> {
    let mismatch = |what: &str| format!("mission {}: {what}", public.id);
    if hidden.id != public.id {
        return Err(mismatch("the sealed file has another mission in its place"));
    }
    if hidden.goals.len() != public.goals.len() {
        return Err(mismatch("public and sealed part have different numbers of goals"));
    }
    let bad =
        finite::tour(&hidden.ordered, "ordered").or_else(|| finite::tour(&hidden.unordered, "unordered"));
    if let Some(what) = bad {
        return Err(finite::cause(what));
    }
    let goal = |(public_goal, sealed): (&PublicGoal, &SealedGoal)| {
        let target = targets.get(&sealed.instance).ok_or_else(|| {
            let instance = sealed.instance;
            format!("mission {} refers to target {instance}, which is not in the file", public.id)
        })?;
        goal_of(public_goal, sealed, target).map_err(mismatch)
    };
    let goals = public.goals.iter().zip(&hidden.goals).map(goal).collect::<Result<_, _>>()?;
    Ok(EpisodeSpec {
        id: hidden.id,
        scene: scene.to_owned(),
        seed: hidden.seed,
        start: public.start,
        goals,
        ordered: hidden.ordered,
        unordered: hidden.unordered,
    })
}

fn goal_of(
    public: &PublicGoal,
    sealed: &SealedGoal,
    target: &SealedTarget,
) -> Result<GoalSpec, &'static str> {
    let cue = match (public, &sealed.view) {
        (PublicGoal::Category(label), None) if *label == target.target.category => CueSpec::Category,
        (PublicGoal::Category(_), None) => {
            return Err("a category goal names another category than its target's");
        }
        (PublicGoal::Description(sentence), None) => {
            CueSpec::Description(Description { text: sentence.clone(), claims: sealed.claims.clone() })
        }
        (PublicGoal::Image, Some(view)) if finite::view(view).is_none() => CueSpec::Image(*view),
        (PublicGoal::Image, Some(_)) => return Err("an image view is not finite"),
        (PublicGoal::Image, None) => return Err("an image goal has no view"),
        (_, Some(_)) => return Err("a goal without an image has a view"),
    };
    if sealed.claims.is_some() && cue.modality() != Modality::Description {
        return Err("a goal without a sentence has claims");
    }
    if finite::number(sealed.start_distance_m, "").is_some() {
        return Err("a start distance is not finite");
    }
    let (modality, start_distance_m) = (cue.modality(), sealed.start_distance_m);
    let filled = Target { modality, start_distance_m, ..target.target.clone() };
    Ok(GoalSpec { target: filled, cue, distractors: target.distractors })
}

/// Message from serde with the column, without the line number, which is always 1.
fn json_error(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let place = format!(" at line {} column {}", error.line(), error.column());
    let what = text.strip_suffix(&place).unwrap_or(&text);
    if error.is_eof() {
        return format!("it ends in the middle of a line, after {} bytes: {what}", error.column());
    }
    format!("{what} (column {})", error.column())
}

/// Finiteness checks: JSON has no infinity, but numbers too large for their type become infinite.
mod finite {
    use crate::{cue::CueView, mission::ReferenceTour};
    use avln_geom::{Point3, Pose};
    use avln_truth::Target;

    /// Name of the first field that is not finite.
    pub(super) type Bad = Option<&'static str>;

    pub(super) fn cause(what: &str) -> String {
        format!("{what} is not a finite number")
    }

    pub(super) fn point(point: &Point3<f32>, what: &'static str) -> Bad {
        (!point.iter().all(|value| value.is_finite())).then_some(what)
    }

    pub(super) fn pose(pose: &Pose, what: &'static str) -> Bad {
        point(&pose.position, what).or((!pose.heading_rad.is_finite()).then_some(what))
    }

    pub(super) fn number(value: f64, what: &'static str) -> Bad {
        (!value.is_finite()).then_some(what)
    }

    pub(super) fn target(target: &Target) -> Bad {
        let bounds = &target.bounds;
        point(&bounds.min, "target.bounds")
            .or_else(|| point(&bounds.max, "target.bounds"))
            .or_else(|| point(&target.source, "target.source"))
            .or_else(|| number(f64::from(target.floor_y_m), "target.floor_y_m"))
            .or_else(|| target.region.iter().find_map(|place| point(place, "target.region")))
            .or_else(|| target.viewpoints.iter().find_map(|place| pose(place, "target.viewpoints")))
    }

    pub(super) fn view(view: &CueView) -> Bad {
        pose(&view.pose, "goals.view").or_else(|| number(f64::from(view.hfov_rad), "goals.view"))
    }

    pub(super) fn tour(tour: &ReferenceTour, what: &'static str) -> Bad {
        number(tour.length_m, what).or_else(|| tour.path.iter().find_map(|corner| point(corner, what)))
    }
}
