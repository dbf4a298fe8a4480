//! Models of two operators, which the tests write themselves, are loaded and looked through.

mod proto;

use avln_client::{GoalCue, Image, Mission, Observation, Pose, TaskSpec};
use avln_kit::perception::{Recognition, Stand};
use avln_onnx::{Brought, ModelsError};
use proto::{floats, model, node, wholes};
use std::{env, fs, path::Path, path::PathBuf, process::Command};

const SIDE: u32 = 64;
/// Where the library of ONNX Runtime is, for those who did not install it for Python.
const LIBRARY: &str = "AVLN_ONNXRUNTIME";
const FIND: &str = "import onnxruntime, glob, os; \
    print(glob.glob(os.path.join(os.path.dirname(onnxruntime.__file__), 'capi', 'libonnxruntime.so*'))[0])";

/// ONNX Runtime; `None`, with a line on what to do, where it is not there.
fn library() -> Option<PathBuf> {
    let python = || {
        let told =
            Command::new("python3").args(["-c", FIND]).output().ok().filter(|told| told.status.success())?;
        String::from_utf8(told.stdout).ok().map(|path| PathBuf::from(path.trim()))
    };
    let found = env::var_os(LIBRARY).map(PathBuf::from).or_else(python);
    if found.is_none() {
        eprintln!(
            "skipped: ONNX Runtime is not here; `pip install onnxruntime` brings it, or set {LIBRARY} to its library"
        );
    }
    found
}

/// Finds a thing in the left half where a picture is red, and one in the right half where it is blue: their scores are the means
/// of these colours, and green is of no box.
fn detector() -> Vec<u8> {
    let boxes = [0.0, 0.0, 0.5, 1.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.0, 1.0, 1.0];
    let parts = [
        floats("fixed", &[1, 3, 4], &boxes),
        wholes("flat", &[1, 3]),
        node("Identity", &["fixed"], "boxes"),
        node("GlobalAveragePool", &["picture"], "means"),
        node("Reshape", &["means", "flat"], "scores"),
    ];
    model(32, &parts, &[("boxes", &[1, 3, 4]), ("scores", &[1, 3])])
}

/// What something looks like is its mean colour.
fn encoder() -> Vec<u8> {
    let parts = [
        wholes("flat", &[1, 3]),
        node("GlobalAveragePool", &["picture"], "means"),
        node("Reshape", &["means", "flat"], "embedding"),
    ];
    model(16, &parts, &[("embedding", &[1, 3])])
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn with(library: &Path, detector: &[u8]) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        let plain = "mean = [0.0, 0.0, 0.0]\nstd = [1.0, 1.0, 1.0]";
        let text = format!(
            "runtime = '{}'\n[detector]\nfile = 'd.onnx'\nside_px = 32\n{plain}\nleast_score = 0.2\n\
             [encoder]\nfile = 'e.onnx'\nside_px = 16\n{plain}\nwords = 'words.json'\nscale = 20.0\nalike = [0.5, 0.9]\n",
            library.display()
        );
        folder.write("models.toml", text.as_bytes());
        folder.write("d.onnx", detector);
        folder.write("e.onnx", &encoder());
        folder.write("words.json", br#"{"bed": [1, 0, 0], "chair": [0, 0, 1], "plant": [0, 1, 0]}"#);
        folder
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.0.path().join(name), bytes).unwrap();
    }

    fn load(&self) -> Result<Brought, ModelsError> {
        Brought::load(&self.0.path().join("models.toml"))
    }
}

/// Red to the left, blue to the right, 2 m ahead.
fn flag() -> Observation {
    let pixels = |i: u32| if i % SIDE < SIDE / 2 { [255, 0, 0] } else { [0, 0, 255] };
    let pixels = (0..SIDE * SIDE).flat_map(pixels).collect();
    let metres = vec![2.0; (SIDE * SIDE) as usize];
    Observation {
        rgb: Some(Image { width: SIDE, height: SIDE, pixels }),
        depth: Some(avln_client::DepthImage { width: SIDE, height: SIDE, metres }),
        ..Observation::default()
    }
}

#[test]
fn things_are_found_named_and_compared() {
    let Some(library) = library() else { return };
    let mut eyes = Folder::with(&library, &detector()).load().unwrap();
    let red = Image { width: 32, height: 32, pixels: [250, 0, 0].repeat(32 * 32) };
    let cues =
        [GoalCue::Category("bed".into()), GoalCue::Description("A blue chair.".into()), GoalCue::Image(red)];
    let task = TaskSpec { width: SIDE, height: SIDE, ..TaskSpec::default() };
    eyes.begin(&task, &Mission { goals: cues.to_vec(), ..Mission::default() });
    let stand = Stand::new(&Pose::default());
    let things = eyes.see(&stand, &flag(), &|_| false).unwrap();
    assert_eq!(things.len(), 2, "{things:?}");
    let bed = things.iter().find(|thing| thing.center().x < 0.0).unwrap();
    let chair = things.iter().find(|thing| thing.center().x > 0.0).unwrap();
    assert!(bed.is_a("bed").unwrap() > 0.99 && chair.is_a("chair").unwrap() > 0.99, "{bed:?} {chair:?}");
    assert!((bed.center().z + 2.0).abs() < 0.01 && (bed.long_m() - 1.9).abs() < 0.15, "{bed:?}");
    for (goal, right, wrong) in [(0, bed, chair), (1, chair, bed), (2, bed, chair)] {
        let (more, less) = (eyes.fit(right, goal), eyes.fit(wrong, goal));
        assert!(more > less + 0.3, "goal {goal}: {more} {less}");
    }
    assert!(eyes.see(&stand, &flag(), &|_| false).is_none(), "nothing is new from the same place");
    assert!(eyes.failure().get().is_none());
}

#[test]
fn what_models_do_not_give_is_told_when_they_are_loaded() {
    let Some(library) = library() else { return };
    let refusal = |folder: &Folder| folder.load().err().expect("a refusal").to_string();
    let swapped = Folder::with(&library, &encoder());
    swapped.write("models.toml", &{
        let text = fs::read_to_string(swapped.0.path().join("models.toml")).unwrap();
        text.replacen("side_px = 32", "side_px = 16", 1).into_bytes()
    });
    assert!(
        refusal(&swapped).contains("d.onnx: it gives 1 outputs, and must give 2"),
        "{}",
        refusal(&swapped)
    );
    let short = Folder::with(&library, &detector());
    short.write("words.json", br#"{"bed": [1, 0]}"#);
    assert!(
        refusal(&short).contains("e.onnx: it gives 3 numbers, and the words have 2"),
        "{}",
        refusal(&short)
    );
    short.write("d.onnx", b"no model");
    assert!(refusal(&short).contains("model ") && refusal(&short).contains("d.onnx"), "{}", refusal(&short));
}
