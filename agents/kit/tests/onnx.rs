//! Loads tiny models, written by the tests themselves, and runs them.

use avln_client::{GoalCue, Image, Mission, Observation, Pose, TaskSpec};
use avln_kit::geometry::Pose2d;
use avln_kit::onnx::{ModelsError, OnnxRecognition};
use avln_kit::perception::Recognition;
use std::{env, fs, io::Write, path::Path, path::PathBuf, process::Command};

const SIDE: u32 = 64;
/// Environment variable with the path of ONNX Runtime, for an installation outside of Python.
const LIBRARY: &str = "AVLN_ONNXRUNTIME";
const FIND: &str = "import onnxruntime, glob, os; \
    print(glob.glob(os.path.join(os.path.dirname(onnxruntime.__file__), 'capi', 'libonnxruntime.so*'))[0])";

/// Prints the skipped test; fails with `AVLN_SKIP=never`.
fn skipped(what: &str) {
    assert!(env::var_os("AVLN_SKIP").is_none_or(|skip| skip != "never"), "AVLN_SKIP is never, but {what}");
    // Not `eprintln!`, which the test harness hides.
    let _ = writeln!(std::io::stderr(), "skipped: {what}");
}

/// Finds ONNX Runtime; prints a hint and returns `None` if it is missing.
fn library() -> Option<PathBuf> {
    let python = || {
        let output = Command::new("python3")
            .args(["-c", FIND])
            .output()
            .ok()
            .filter(|output| output.status.success())?;
        String::from_utf8(output.stdout).ok().map(|path| PathBuf::from(path.trim()))
    };
    let found = env::var_os(LIBRARY).map(PathBuf::from).or_else(python);
    if found.is_none() {
        skipped(&format!(
            "ONNX Runtime is missing; run `pip install onnxruntime`, or set {LIBRARY} to its library"
        ));
    }
    found
}

/// A detector with a box on the left scored by the mean of red, one on the right scored by blue, and an empty one for green.
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

/// The boxes of `detector`, with a score per class: red, green and blue.
fn class_detector() -> Vec<u8> {
    let boxes = [0.0, 0.0, 0.5, 1.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.0, 1.0, 1.0];
    let own_class = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let parts = [
        floats("fixed", &[1, 3, 4], &boxes),
        floats("own_class", &[1, 3, 3], &own_class),
        wholes("row", &[1, 1, 3]),
        node("Identity", &["fixed"], "boxes"),
        node("GlobalAveragePool", &["picture"], "means"),
        node("Reshape", &["means", "row"], "by_class"),
        node("Mul", &["by_class", "own_class"], "scores"),
    ];
    model(32, &parts, &[("boxes", &[1, 3, 4]), ("scores", &[1, 3, 3])])
}

const CLASSES: &str = "classes = ['bed', 'plant', 'chair']\nsure_score = 0.5\n";

/// An encoder whose embedding is the mean colour.
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

    /// Replaces the encoder by class names.
    fn with_classes(library: &Path, classes: &str) -> Self {
        let folder = Self::with(library, &class_detector());
        let text = fs::read_to_string(folder.0.path().join("models.toml")).unwrap();
        let (detector, _) = text.split_once("[encoder]").unwrap();
        folder.write("models.toml", format!("{detector}{classes}").as_bytes());
        folder
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.0.path().join(name), bytes).unwrap();
    }

    fn load(&self) -> Result<OnnxRecognition, ModelsError> {
        OnnxRecognition::load(&self.0.path().join("models.toml"))
    }
}

/// Red on the left, blue on the right, 2 m ahead.
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
fn objects_are_detected_named_and_compared() {
    let Some(library) = library() else { return };
    let mut recognition = Folder::with(&library, &detector()).load().unwrap();
    let red = Image { width: 32, height: 32, pixels: [250, 0, 0].repeat(32 * 32) };
    let cues =
        [GoalCue::Category("bed".into()), GoalCue::Description("A blue chair.".into()), GoalCue::Image(red)];
    let task = TaskSpec { width: SIDE, height: SIDE, ..TaskSpec::default() };
    recognition.begin(&task, &Mission { goals: cues.to_vec(), ..Mission::default() });
    let pose = Pose2d::new(&Pose::default());
    let detections = recognition.see(&pose, &flag(), &|_| false).unwrap();
    assert_eq!(detections.len(), 2, "{detections:?}");
    let bed = detections.iter().find(|detection| detection.center().x < 0.0).unwrap();
    let chair = detections.iter().find(|detection| detection.center().x > 0.0).unwrap();
    assert!(bed.is_a("bed").unwrap() > 0.99 && chair.is_a("chair").unwrap() > 0.99, "{bed:?} {chair:?}");
    assert!((bed.center().z + 2.0).abs() < 0.01 && (bed.long_m() - 1.9).abs() < 0.15, "{bed:?}");
    for (goal, right, wrong) in [(0, bed, chair), (1, chair, bed), (2, bed, chair)] {
        let (more, less) = (recognition.fit(right, goal), recognition.fit(wrong, goal));
        assert!(more > less + 0.3, "goal {goal}: {more} {less}");
    }
    assert!(recognition.see(&pose, &flag(), &|_| false).is_none(), "equal views are skipped");
    assert!(recognition.failure().get().is_none());
}

#[test]
fn detectors_with_classes_need_no_encoder() {
    let Some(library) = library() else { return };
    let mut recognition = Folder::with_classes(&library, CLASSES).load().unwrap();
    let blue = Image { width: 32, height: 32, pixels: [0, 0, 250].repeat(32 * 32) };
    let green = Image { width: 32, height: 32, pixels: [0, 250, 0].repeat(32 * 32) };
    let cues = [GoalCue::Category("bed".into()), GoalCue::Description("An armchair.".into())];
    let goals = cues.into_iter().chain([blue, green].map(GoalCue::Image)).collect();
    let task = TaskSpec { width: SIDE, height: SIDE, ..TaskSpec::default() };
    recognition.begin(&task, &Mission { goals, ..Mission::default() });
    let detections = recognition.see(&Pose2d::new(&Pose::default()), &flag(), &|_| false).unwrap();
    let [left, right] = detections.as_slice() else { panic!("{detections:?}") };
    assert!(left.is_a("bed").unwrap() > 0.9 && right.is_a("chair").unwrap() > 0.9, "{detections:?}");
    assert_eq!((left.is_a("armchair"), right.is_a("armchair")), (Some(0.0), right.is_a("chair")));
    let fit = |goal| [left, right].map(|detection| recognition.fit(detection, goal));
    assert!(fit(0)[0] > 0.9 && fit(1)[1] > 0.9, "{:?} {:?}", fit(0), fit(1));
    assert!(fit(2)[1] > fit(2)[0] + 0.3, "the blue box matches: {:?}", fit(2));
    assert!(fit(3).iter().all(|&fit| fit < 0.4), "nothing is green: {:?}", fit(3));
    assert!(recognition.failure().get().is_none());
}

#[test]
fn class_count_must_match_the_scores() {
    let Some(library) = library() else { return };
    let error = Folder::with_classes(&library, "classes = ['bed', 'chair']").load().err().expect("a refusal");
    assert!(error.to_string().contains("3 scores per box, but detector.classes has 2 names"), "{error}");
}

/// Environment variable with the models file written by `models/centernet.py`.
const CENTERNET: &str = "AVLN_CENTERNET";

#[test]
fn converted_centernet_runs() {
    let Some(models) = env::var_os(CENTERNET) else {
        skipped(&format!(
            "no converted CenterNet; run models/centernet.py, and set {CENTERNET} to its models.toml"
        ));
        return;
    };
    let mut recognition = OnnxRecognition::load(Path::new(&models)).unwrap();
    recognition.begin(&TaskSpec { width: SIDE, height: SIDE, ..TaskSpec::default() }, &Mission::default());
    assert!(recognition.see(&Pose2d::new(&Pose::default()), &flag(), &|_| false).is_some());
    assert!(recognition.failure().get().is_none());
}

#[test]
fn invalid_model_outputs_are_refused_on_loading() {
    let Some(library) = library() else { return };
    let refusal = |folder: &Folder| folder.load().err().expect("a refusal").to_string();
    let swapped = Folder::with(&library, &encoder());
    swapped.write("models.toml", &{
        let text = fs::read_to_string(swapped.0.path().join("models.toml")).unwrap();
        text.replacen("side_px = 32", "side_px = 16", 1).into_bytes()
    });
    assert!(refusal(&swapped).contains("d.onnx: it has 1 outputs instead of 2"), "{}", refusal(&swapped));
    let short = Folder::with(&library, &detector());
    short.write("words.json", br#"{"bed": [1, 0]}"#);
    assert!(
        refusal(&short).contains("e.onnx: its output has 3 numbers, but the word embeddings have 2"),
        "{}",
        refusal(&short)
    );
    short.write("d.onnx", b"no model");
    assert!(refusal(&short).contains("model ") && refusal(&short).contains("d.onnx"), "{}", refusal(&short));
}

/// Encodes a field of bytes: a message, text or packed numbers (onnx.proto3).
fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
    let mut all = vec![number << 3 | 2];
    all.extend(varint(bytes.len() as u64));
    all.extend_from_slice(bytes);
    all
}

fn number(field: u8, value: u64) -> Vec<u8> {
    let mut all = vec![field << 3];
    all.extend(varint(value));
    all
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value > 0x7f {
        bytes.push(value as u8 & 0x7f | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

/// Encodes an operator of a graph.
fn node(operator: &str, inputs: &[&str], output: &str) -> Vec<u8> {
    let inputs = inputs.iter().flat_map(|input| field(1, input.as_bytes()));
    let node: Vec<u8> =
        inputs.chain(field(2, output.as_bytes())).chain(field(4, operator.as_bytes())).collect();
    field(1, &node)
}

/// Encodes a constant of floats.
fn floats(name: &str, shape: &[u64], values: &[f32]) -> Vec<u8> {
    const FLOAT: u64 = 1;
    let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    tensor(name, shape, FLOAT, &raw)
}

/// Encodes a constant of integers.
fn wholes(name: &str, values: &[i64]) -> Vec<u8> {
    const INT64: u64 = 7;
    let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    tensor(name, &[values.len() as u64], INT64, &raw)
}

fn tensor(name: &str, shape: &[u64], kind: u64, raw: &[u8]) -> Vec<u8> {
    let shape = shape.iter().flat_map(|&side| number(1, side));
    let tensor: Vec<u8> =
        shape.chain(number(2, kind)).chain(field(8, name.as_bytes())).chain(field(9, raw)).collect();
    field(5, &tensor)
}

/// Encodes a model with the input `picture`, 1 x 3 x `side` x `side`, and outputs of these names and shapes.
fn model(side: u64, parts: &[Vec<u8>], outputs: &[(&str, &[u64])]) -> Vec<u8> {
    let mut graph: Vec<u8> = parts.concat();
    graph.extend(field(2, b"tiny"));
    graph.extend(field(11, &value("picture", &[1, 3, side, side])));
    outputs.iter().for_each(|(name, shape)| graph.extend(field(12, &value(name, shape))));
    let opset = [field(1, b""), number(2, 13)].concat();
    [number(1, 8), field(7, &graph), field(8, &opset)].concat()
}

fn value(name: &str, shape: &[u64]) -> Vec<u8> {
    let sides: Vec<u8> = shape.iter().flat_map(|&side| field(1, &number(1, side))).collect();
    let tensor = [number(1, 1), field(2, &sides)].concat();
    [field(1, name.as_bytes()), field(2, &field(1, &tensor))].concat()
}
