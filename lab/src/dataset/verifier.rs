//! Verifiers of targets: the agents' bundled network, or ONNX models of the user.

use avln_arena::Failure;
use avln_client::{DepthImage, Image, Mission, Observation, TaskSpec};
use avln_dataset::{DetectorView, ThresholdsOnly, Verifier, VerifierId};
use avln_geom::{Point3, Vector3};
use avln_kit::geometry::Pose2d;
use avln_kit::onnx::{OnnxRecognition, SharedFailure};
use avln_kit::perception::{DetectedObject, NetworkRecognition, Recognition};
use avln_perception::VisionNetwork;
use avln_scene::Object;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

/// Name of the bundled network in recipes.
const NETWORK: &str = "network";
/// Least probability of the target's category.
const LEAST_PROBABILITY: f32 = 0.5;
/// Largest distance between the centre of a detected object and the target's box, metres.
const REACH_M: f32 = 0.15;
/// Key of the ONNX Runtime library in a file with models. The library is not a part of the detector's identity.
const RUNTIME: &str = "runtime";

/// A shared verifier.
pub type BoxedVerifier = Box<dyn Verifier + Send>;

/// Choice of a verifier.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VerifierChoice {
    /// Survey thresholds only.
    None,
    /// The agents' bundled network.
    Network,
    /// A file with ONNX models.
    Models(PathBuf),
}

impl FromStr for VerifierChoice {
    type Err = String;

    /// Parses `none`, `network`, or the path of a TOML file.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "none" => Ok(Self::None),
            NETWORK => Ok(Self::Network),
            path if path.ends_with(".toml") => Ok(Self::Models(path.into())),
            _ => Err("use network, none or the path of a .toml file with models (docs/models.md)".to_owned()),
        }
    }
}

impl VerifierChoice {
    /// Loads the verifier.
    ///
    /// # Errors
    /// If a file cannot be read or a model is unsuitable.
    pub fn load(&self) -> Result<BoxedVerifier, Failure> {
        match self {
            Self::None => Ok(Box::new(ThresholdsOnly)),
            Self::Network => Ok(Box::new(Detector::network())),
            Self::Models(path) => Ok(Box::new(Detector::models(path)?)),
        }
    }
}

/// Loads the verifier recorded in a recipe; `models` is the user's file with models, if given.
///
/// # Errors
/// If this program has another version of the network, or the file is absent or different.
pub fn recorded(id: Option<&VerifierId>, models: Option<&Path>) -> Result<BoxedVerifier, Failure> {
    let Some(id) = id else { return VerifierChoice::None.load() };
    let choice = match models {
        _ if id.name == NETWORK => VerifierChoice::Network,
        Some(path) => VerifierChoice::Models(path.to_owned()),
        None => {
            return Err(Failure::data(format!(
                "the targets were verified by {id}, which is not a part of this program"
            ))
            .hinted(format!("name the file with the models: --verifier {}", id.name)));
        }
    };
    let verifier = choice.load()?;
    let found = verifier.id().and_then(|found| found.digest);
    // Recipes by hand contain no digest.
    if id.digest.is_some() && found != id.digest {
        let found = found.unwrap_or_default();
        return Err(Failure::data(format!(
            "the targets were verified by {id}, but this verifier has digest {found}"
        ))
        .hinted("use the program or the files that built the data set, or build it again"));
    }
    Ok(verifier)
}

/// A detector with a pool of loaded models, one per thread.
struct Detector {
    id: VerifierId,
    models: Option<PathBuf>,
    idle: Mutex<Vec<LoadedModels>>,
}

struct LoadedModels {
    recognition: Box<dyn Recognition>,
    failure: SharedFailure,
}

impl Detector {
    fn network() -> Self {
        Self::new(NETWORK, blake3::hash(VisionNetwork::WEIGHTS).to_hex().to_string(), None)
    }

    fn models(path: &Path) -> Result<Self, Failure> {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let detector = Self::new(&name, digest_of_models(path)?, Some(path.to_owned()));
        // Unsuitable models must fail before the build.
        let loaded = detector.load().map_err(Failure::data)?;
        detector.put(loaded);
        Ok(detector)
    }

    fn new(name: &str, digest: String, models: Option<PathBuf>) -> Self {
        let id = VerifierId { name: name.to_owned(), digest: Some(digest) };
        Self { id, models, idle: Mutex::default() }
    }

    fn load(&self) -> Result<LoadedModels, String> {
        let Some(path) = &self.models else {
            let recognition = NetworkRecognition::new().map_err(|error| error.to_string())?;
            return Ok(LoadedModels {
                recognition: Box::new(recognition),
                failure: SharedFailure::default(),
            });
        };
        let recognition = OnnxRecognition::load(path).map_err(|error| error.to_string())?;
        let failure = recognition.failure();
        Ok(LoadedModels { recognition: Box::new(recognition), failure })
    }

    fn take(&self) -> Result<LoadedModels, String> {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        idle.map_or_else(|| self.load(), Ok)
    }

    fn put(&self, loaded: LoadedModels) {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(loaded);
    }
}

impl Verifier for Detector {
    fn id(&self) -> Option<VerifierId> {
        Some(self.id.clone())
    }

    fn recognises(&self, view: &DetectorView, objects: &[&Object]) -> Result<Vec<bool>, String> {
        let mut loaded = self.take()?;
        // Every picture is a mission of its own, so that a verdict does not depend on earlier pictures.
        loaded.recognition.begin(&task_of(view), &Mission::default());
        let seen = loaded.recognition.see(
            &Pose2d::new(&avln_client::Pose::default()),
            &observation_of(view),
            &|_| false,
        );
        if let Some(error) = loaded.failure.get() {
            return Err(error.to_string());
        }
        self.put(loaded);
        let seen = seen.unwrap_or_default();
        Ok(objects.iter().map(|object| seen.iter().any(|detected| matches(view, detected, object))).collect())
    }
}

fn task_of(view: &DetectorView) -> TaskSpec {
    TaskSpec {
        width: view.frame.width,
        height: view.frame.height,
        hfov_rad: view.hfov_rad,
        camera_height_m: view.camera_height_m,
        depth_max_m: view.depth_max_m,
        ..TaskSpec::default()
    }
}

fn observation_of(view: &DetectorView) -> Observation {
    let (width, height) = (view.frame.width, view.frame.height);
    Observation {
        rgb: Some(Image { width, height, pixels: view.frame.rgb.clone() }),
        depth: Some(DepthImage { width, height, metres: view.frame.depth.clone() }),
        ..Observation::default()
    }
}

/// True if a detected object probably has the category, and its centre is in the box or near it.
fn matches(view: &DetectorView, detected: &DetectedObject, object: &Object) -> bool {
    let probability = detected.is_a(&object.category).unwrap_or(0.0);
    probability >= LEAST_PROBABILITY && object.bounds.distance_m(&center_of(view, detected)) <= REACH_M
}

/// Returns the centre of a detected object in the scene.
fn center_of(view: &DetectorView, detected: &DetectedObject) -> Point3<f32> {
    let middle = |low: f32, high: f32| 0.5 * (low + high);
    let in_body = Vector3::new(
        middle(detected.min.x, detected.max.x),
        middle(detected.low_m, detected.high_m),
        middle(detected.min.z, detected.max.z),
    );
    view.pose.position + view.pose.rotation() * in_body
}

/// Returns the digest of a file with models and of all files named in it, apart from the runtime library.
fn digest_of_models(path: &Path) -> Result<String, Failure> {
    let read = |path: &Path| std::fs::read(path).map_err(|error| Failure::file("read", path, error));
    let text = String::from_utf8_lossy(&read(path)?).into_owned();
    let table: toml::Table =
        text.parse().map_err(|error| Failure::data(format!("{}: {error}", path.display())))?;
    let mut files = BTreeMap::new();
    collect_files("", &toml::Value::Table(table), path.parent().unwrap_or(Path::new(".")), &mut files);
    let mut hasher = blake3::Hasher::new();
    hasher.update(blake3::hash(text.as_bytes()).as_bytes());
    for file in files.values() {
        hasher.update(blake3::hash(&read(file)?).as_bytes());
    }
    Ok(hasher.finalize().to_hex().to_string())
}

/// Adds the existing files named in `value` by key.
fn collect_files(key: &str, value: &toml::Value, folder: &Path, files: &mut BTreeMap<String, PathBuf>) {
    match value {
        toml::Value::Table(table) => {
            let inner = table.iter().filter(|(name, _)| *name != RUNTIME);
            inner.for_each(|(name, value)| collect_files(&format!("{key}.{name}"), value, folder, files));
        }
        toml::Value::String(name) if folder.join(name).is_file() => {
            files.insert(key.to_owned(), folder.join(name));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_dataset::{SceneSource, SceneSpec, SurveyOptions, survey_with};
    use avln_episode::Rules;
    use avln_houses::Pool;
    use std::fs;

    #[test]
    fn choices_are_parsed() {
        assert_eq!("none".parse(), Ok(VerifierChoice::None));
        assert_eq!("network".parse(), Ok(VerifierChoice::Network));
        assert_eq!("a/coco.toml".parse(), Ok(VerifierChoice::Models("a/coco.toml".into())));
        assert!("coco".parse::<VerifierChoice>().expect_err("unknown").contains("network, none"));
    }

    #[test]
    fn recorded_network_needs_its_digest() {
        let id = Detector::network().id;
        assert_eq!(recorded(Some(&id), None).expect("the same").id(), Some(id.clone()));
        assert_eq!(recorded(None, None).expect("none").id(), None);
        let by_hand = VerifierId { digest: None, ..id.clone() };
        assert_eq!(recorded(Some(&by_hand), None).expect("any").id(), Some(id.clone()));
        let older = VerifierId { digest: Some("00".to_owned()), ..id };
        let error = recorded(Some(&older), None).err().expect("another network").to_string();
        assert!(error.contains("network (00)"), "{error}");
        let foreign = VerifierId { name: "coco.toml".to_owned(), digest: None };
        let error = recorded(Some(&foreign), None).err().expect("absent").to_string();
        assert!(error.contains("coco.toml"), "{error}");
    }

    #[test]
    fn digest_covers_all_model_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("models.toml");
        let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("writable");
        let digest = || digest_of_models(&path).expect("readable");
        write("models.toml", "runtime = \"lib.so\"\n[detector]\nfile = \"a.onnx\"\nside_px = 640");
        write("a.onnx", "weights");
        write("lib.so", "library");
        let before = digest();
        write("lib.so", "another library");
        assert_eq!(digest(), before);
        write("a.onnx", "other weights");
        assert_ne!(digest(), before);
        write("models.toml", "runtime = ");
        assert!(digest_of_models(&path).is_err());
    }

    #[test]
    fn network_recognises_most_targets() {
        let rules = Rules::paper();
        let source =
            SceneSource::Procedural { seed: 21, rooms: 6..=6, storeys: 1..=1, pool: Pool::Validation };
        let (spec, _) = SceneSpec::new("house", source).expect("a house");
        let assets = spec.open(&rules).expect("a house");
        let options = SurveyOptions::default();
        let by = |verifier: &dyn Verifier| {
            survey_with(&assets, &rules, &options, verifier, &(0..=u8::MAX)).expect("no failure")
        };
        let (all, network) = (by(&ThresholdsOnly), Detector::network());
        let verified = by(&network);
        let (kept, removed) = (verified.instances.len(), verified.removals.verifier as usize);
        assert_eq!(kept + removed, all.instances.len());
        assert!(kept * 10 >= all.instances.len() * 7 && removed > 0, "{kept} of {}", all.instances.len());
        assert_eq!(by(&network), verified, "a used network gives equal verdicts");
    }
}
