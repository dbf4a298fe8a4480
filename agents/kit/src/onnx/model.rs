//! Configuration and inference of ONNX models.

use avln_client::Image;
use ort::environment::Environment;
use ort::session::{Session, SessionOutputs};
use ort::value::Tensor;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::{fs, io};

/// An image crop, in shares: left, top, right, bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CropBox(pub(crate) [f32; 4]);

impl CropBox {
    pub(crate) const ALL: Self = Self([0.0, 0.0, 1.0, 1.0]);

    /// Clamps the crop to the image; `None` if nothing is left.
    pub(crate) fn inside(self) -> Option<Self> {
        let [left, top, right, bottom] = self.0.map(|share| share.clamp(0.0, 1.0));
        (left < right && top < bottom).then_some(Self([left, top, right, bottom]))
    }

    /// Returns the pixel range between two shares.
    fn span(from: f32, to: f32, pixels: usize) -> std::ops::Range<usize> {
        let first = ((from * pixels as f32) as usize).min(pixels.saturating_sub(1));
        first..((to * pixels as f32).ceil() as usize).clamp(first + 1, pixels.max(first + 1))
    }

    pub(crate) fn columns(self, width: usize) -> std::ops::Range<usize> {
        Self::span(self.0[0], self.0[2], width)
    }

    pub(crate) fn rows(self, height: usize) -> std::ops::Range<usize> {
        Self::span(self.0[1], self.0[3], height)
    }

    pub(crate) fn middle(self) -> Self {
        let [left, top, right, bottom] = self.0;
        let (x, y) = (0.25 * (right - left), 0.25 * (bottom - top));
        Self([left + x, top + y, right - x, bottom - y])
    }
}

/// Converts a crop to planes of red, green and blue, row by row, resized bilinearly to a square.
pub(crate) fn planes(image: &Image, frame: CropBox, model: &ModelFile) -> Vec<f32> {
    let (side, width, height) = (model.side_px, image.width as usize, image.height as usize);
    let [left, top, right, bottom] = frame.0;
    let taps = |low: f32, high: f32, pixels: usize| -> Vec<(usize, usize, f32)> {
        let at =
            |index: usize| (low + (high - low) * (index as f32 + 0.5) / side as f32) * pixels as f32 - 0.5;
        let most = pixels.saturating_sub(1);
        let tap = |at: f32| ((at as usize).min(most), (at as usize + 1).min(most), at.fract());
        (0..side).map(|index| tap(at(index).max(0.0))).collect()
    };
    let (columns, rows) = (taps(left, right, width), taps(top, bottom, height));
    let mut planes = Vec::with_capacity(3 * side * side);
    for channel in 0..3 {
        let value = |x: usize, y: usize| f32::from(image.pixels[3 * (y * width + x) + channel]) / 255.0;
        for &(y0, y1, down) in &rows {
            for &(x0, x1, across) in &columns {
                let upper = value(x0, y0) * (1.0 - across) + value(x1, y0) * across;
                let lower = value(x0, y1) * (1.0 - across) + value(x1, y1) * across;
                let mixed = upper * (1.0 - down) + lower * down;
                planes.push((mixed - model.mean[channel]) / model.std[channel]);
            }
        }
    }
    planes
}

/// ONNX Runtime, loaded once per process.
static RUNTIME: Mutex<Option<Environment>> = Mutex::new(None);

pub(crate) struct Model {
    about: ModelFile,
    session: Session,
}

/// An output's shape and values.
pub(crate) type Numbers = (Vec<usize>, Vec<f32>);

impl Model {
    /// Loads a model, and ONNX Runtime from `library` if necessary.
    pub(crate) fn load(library: &Path, about: ModelFile) -> Result<Self, ModelsError> {
        let environment = runtime(library)?;
        let session = Session::builder(&environment)
            .map_err(|error| error.to_string())
            .and_then(|builder| builder.with_intra_threads(1).map_err(|error| error.to_string()))
            .and_then(|mut builder| builder.commit_from_file(&about.file).map_err(|error| error.to_string()));
        match session {
            Ok(session) => Ok(Self { about, session }),
            Err(problem) => Err(ModelsError::Model { path: about.file, problem }),
        }
    }

    /// Runs the model on a crop and returns the first `N` outputs.
    pub(crate) fn run<const N: usize>(
        &mut self,
        image: &Image,
        frame: CropBox,
    ) -> Result<[Numbers; N], ModelsError> {
        let side = self.about.side_px;
        let fail = |problem: String| ModelsError::Model { path: self.about.file.clone(), problem };
        let tensor = Tensor::from_array(([1, 3, side, side], planes(image, frame, &self.about)));
        let tensor = tensor.map_err(|error| fail(error.to_string()))?;
        let given = self.session.run(ort::inputs![tensor]).map_err(|error| fail(error.to_string()))?;
        if given.len() < N {
            return Err(fail(format!("it has {} outputs instead of {N}", given.len())));
        }
        let mut outputs = [(); N].map(|()| Numbers::default());
        for (index, output) in outputs.iter_mut().enumerate() {
            *output = numbers(&given, index).map_err(&fail)?;
        }
        Ok(outputs)
    }

    pub(crate) fn wrong(&self, problem: String) -> ModelsError {
        ModelsError::Model { path: self.about.file.clone(), problem }
    }
}

fn runtime(library: &Path) -> Result<Environment, ModelsError> {
    let mut loaded = RUNTIME.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    if let Some(environment) = &*loaded {
        return Ok(environment.clone());
    }
    let fail = |problem: String| ModelsError::Runtime { path: library.to_owned(), problem };
    let builder = ort::init_from(library).map_err(|error| fail(error.to_string()))?;
    let environment = builder.with_telemetry(false).build().map_err(|error| fail(error.to_string()))?;
    Ok(loaded.insert(environment).clone())
}

fn numbers(given: &SessionOutputs, index: usize) -> Result<Numbers, String> {
    let (shape, values) = given[index]
        .try_extract_tensor::<f32>()
        .map_err(|error| format!("its output {index} is not a tensor of f32: {error}"))?;
    let shape = shape.iter().map(|&side| usize::try_from(side).unwrap_or(0)).collect();
    match values.iter().all(|value| value.is_finite()) {
        true => Ok((shape, values.to_vec())),
        false => Err(format!("its output {index} has non-finite values")),
    }
}

/// Sides of the square model inputs, pixels.
const SIDES_PX: [usize; 2] = [8, 2048];

/// The model configuration; relative paths start at its folder.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Models {
    pub(crate) runtime: PathBuf,
    pub(crate) detector: Detector,
    pub(crate) encoder: Option<Encoder>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Detector {
    #[serde(flatten)]
    pub(crate) model: ModelFile,
    pub(crate) least_score: f32,
    /// Category per score of a box; empty for a class-agnostic detector.
    #[serde(default)]
    pub(crate) classes: Vec<String>,
    /// Score of a certain class.
    #[serde(default = "one")]
    pub(crate) sure_score: f32,
}

fn one() -> f32 {
    1.0
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Encoder {
    #[serde(flatten)]
    pub(crate) model: ModelFile,
    /// JSON file with an embedding per word.
    pub(crate) words: PathBuf,
    /// Factor on cosines of images and words before the softmax.
    pub(crate) scale: f32,
    /// Embedding cosines for different and for equal objects.
    pub(crate) alike: [f32; 2],
}

#[derive(Clone, Debug, Deserialize)]
pub(crate) struct ModelFile {
    pub(crate) file: PathBuf,
    pub(crate) side_px: usize,
    /// Mean and standard deviation of red, green and blue, 0 to 1: inputs are normalised by them.
    pub(crate) mean: [f32; 3],
    pub(crate) std: [f32; 3],
}

/// Reasons for unusable models.
#[derive(Debug, thiserror::Error)]
pub enum ModelsError {
    /// The configuration or the words cannot be read.
    #[error("cannot read {}: {error}", path.display())]
    Unreadable {
        /// File.
        path: PathBuf,
        /// System error.
        error: io::Error,
    },
    /// A file is malformed.
    #[error("{}: {problem}; docs/models.md has an example", path.display())]
    Malformed {
        /// File.
        path: PathBuf,
        /// Description.
        problem: String,
    },
    /// ONNX Runtime cannot be loaded.
    #[error(
        "cannot load ONNX Runtime from {}: {problem}; install it with `pip install onnxruntime` and set `runtime` to its \
         libonnxruntime.so",
        path.display()
    )]
    Runtime {
        /// Library.
        path: PathBuf,
        /// System error.
        problem: String,
    },
    /// A model cannot be loaded, or an output is invalid.
    #[error("model {}: {problem}; docs/models.md specifies inputs and outputs", path.display())]
    Model {
        /// Model file.
        path: PathBuf,
        /// Description.
        problem: String,
    },
}

impl Models {
    /// Reads a configuration and resolves the paths.
    pub(crate) fn read(path: &Path) -> Result<Self, ModelsError> {
        let mut models: Self =
            toml::from_str(&text(path)?).map_err(|error| malformed(path, error.to_string().trim()))?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let encoder = models.encoder.as_mut();
        let encoder_files = encoder.map(|encoder| [&mut encoder.model.file, &mut encoder.words]);
        let own_files = [&mut models.runtime, &mut models.detector.model.file];
        for file in own_files.into_iter().chain(encoder_files.into_iter().flatten()) {
            *file = folder.join(&*file);
        }
        models.check().map_err(|problem| malformed(path, &problem))?;
        Ok(models)
    }

    fn check(&self) -> Result<(), String> {
        self.detector.check()?;
        match &self.encoder {
            Some(encoder) if self.detector.classes.is_empty() => encoder.check(),
            None if !self.detector.classes.is_empty() => Ok(()),
            _ => Err("boxes get names from detector.classes or from [encoder]; give one of them".to_owned()),
        }
    }
}

impl Detector {
    fn check(&self) -> Result<(), String> {
        self.model.check("detector")?;
        within("detector.least_score", self.least_score, 0.0, 1.0)?;
        within("detector.sure_score", self.sure_score, 0.01, 1.0)
    }
}

impl Encoder {
    fn check(&self) -> Result<(), String> {
        self.model.check("encoder")?;
        within("encoder.scale", self.scale, 0.1, 1000.0)?;
        let [unlike, alike] = self.alike;
        within("encoder.alike, first,", unlike, -1.0, 1.0)?;
        within("encoder.alike, second,", alike, unlike + 0.001, 1.0)
    }
}

impl ModelFile {
    fn check(&self, name: &str) -> Result<(), String> {
        let [least, most] = SIDES_PX;
        if !(least..=most).contains(&self.side_px) {
            return Err(format!("{name}.side_px is {}, and must be from {least} to {most}", self.side_px));
        }
        self.mean.iter().try_for_each(|&mean| within(&format!("{name}.mean"), mean, -10.0, 10.0))?;
        self.std.iter().try_for_each(|&std| within(&format!("{name}.std"), std, 0.001, 10.0))
    }
}

/// Reads words and their unit embeddings.
pub(crate) fn words(path: &Path) -> Result<Vec<(String, Vec<f32>)>, ModelsError> {
    let words: BTreeMap<String, Vec<f32>> =
        serde_json::from_str(&text(path)?).map_err(|error| malformed(path, &error.to_string()))?;
    let length = words.values().next().map_or(0, Vec::len);
    if length == 0 {
        return Err(malformed(path, "there are no embeddings"));
    }
    let unlike = words.iter().find(|(_, embedding)| embedding.len() != length);
    if let Some((word, embedding)) = unlike {
        let problem =
            format!("the embedding of '{word}' has {} numbers, the first has {length}", embedding.len());
        return Err(malformed(path, &problem));
    }
    Ok(words.into_iter().map(|(word, embedding)| (word.replace(' ', "_"), unit(&embedding))).collect())
}

pub(crate) fn unit(vector: &[f32]) -> Vec<f32> {
    let length = vector.iter().map(|value| value * value).sum::<f32>().sqrt().max(f32::EPSILON);
    vector.iter().map(|value| value / length).collect()
}

fn within(name: &str, value: f32, least: f32, most: f32) -> Result<(), String> {
    let is_within = (least..=most).contains(&value);
    is_within.then_some(()).ok_or_else(|| format!("{name} is {value}, and must be from {least} to {most}"))
}

fn text(path: &Path) -> Result<String, ModelsError> {
    fs::read_to_string(path).map_err(|error| ModelsError::Unreadable { path: path.to_owned(), error })
}

fn malformed(path: &Path, problem: &str) -> ModelsError {
    ModelsError::Malformed { path: path.to_owned(), problem: problem.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::category::noun_of;

    fn model(side_px: usize) -> ModelFile {
        ModelFile { file: "m".into(), side_px, mean: [0.5, 0.0, 0.0], std: [0.5, 1.0, 1.0] }
    }

    /// Left half red, right half blue.
    fn flag() -> Image {
        let pixels = (0..8 * 8).flat_map(|i| if i % 8 < 4 { [255, 0, 0] } else { [0, 0, 255] }).collect();
        Image { width: 8, height: 8, pixels }
    }

    #[test]
    fn crops_become_three_planes() {
        let red = planes(&flag(), CropBox([0.0, 0.0, 0.4, 1.0]), &model(4));
        assert!(red[..16].iter().all(|&value| value == 1.0) && red[16..].iter().all(|&value| value == 0.0));
        let all = planes(&flag(), CropBox::ALL, &model(8));
        assert_eq!((all[0], all[7], all[128], all[135]), (1.0, -1.0, 0.0, 1.0));
    }

    #[test]
    fn crops_are_clamped_to_the_image() {
        assert_eq!(CropBox([-0.5, 0.2, 0.5, 1.7]).inside(), Some(CropBox([0.0, 0.2, 0.5, 1.0])));
        assert_eq!(CropBox([0.5, 0.2, 0.5, 0.3]).inside(), None);
        assert_eq!(CropBox([f32::NAN, 0.0, 1.0, 1.0]).inside(), None);
        let thin = CropBox([0.99, 0.0, 1.0, 1.0]);
        assert_eq!((thin.columns(8), thin.rows(8)), (7..8, 0..8));
    }

    #[test]
    fn missing_onnx_runtime_is_explained() {
        let refusal =
            runtime(Path::new("absent/libonnxruntime.so")).expect_err("nothing is there").to_string();
        assert!(refusal.contains("absent/libonnxruntime.so") && refusal.contains("pip install onnxruntime"));
    }

    const TEXT: &str = r#"
        runtime = "libonnxruntime.so"
        [detector]
        file = "detector.onnx"
        side_px = 640
        mean = [0.0, 0.0, 0.0]
        std = [1.0, 1.0, 1.0]
        least_score = 0.2
        [encoder]
        file = "/models/encoder.onnx"
        side_px = 224
        mean = [0.48, 0.46, 0.41]
        std = [0.27, 0.26, 0.28]
        words = "words.json"
        scale = 100.0
        alike = [0.5, 0.9]
    "#;

    fn read(text: &str) -> Result<Models, ModelsError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("models.toml");
        fs::write(&path, text).unwrap();
        Models::read(&path)
    }

    #[test]
    fn relative_paths_start_at_the_file() {
        let models = read(TEXT).unwrap();
        assert!(models.detector.model.file.is_absolute() && models.runtime.ends_with("libonnxruntime.so"));
        assert_eq!(models.encoder.unwrap().model.file, Path::new("/models/encoder.onnx"));
    }

    #[test]
    fn documented_examples_are_valid() {
        let models = read(include_str!("../../../../docs/models.toml")).unwrap();
        assert_eq!((models.detector.model.side_px, models.encoder.unwrap().model.side_px), (640, 224));
        let models = read(include_str!("../../models/centernet.toml")).unwrap();
        assert_eq!((models.detector.classes.len(), models.encoder.is_none()), (80, true));
    }

    #[test]
    fn converted_classes_are_known_categories() {
        let classes = read(include_str!("../../models/centernet.toml")).unwrap().detector.classes;
        let coco = [(13, "seating"), (56, "chair"), (57, "sofa"), (58, "plant"), (59, "bed"), (60, "table")];
        let rest = [(61, "toilet"), (62, "tv_monitor"), (69, "stove"), (71, "sink"), (72, "refrigerator")];
        for (number, name) in coco.into_iter().chain(rest) {
            assert_eq!(classes[number], name);
            assert_eq!(noun_of(&[name]), Some((name, 1)));
        }
    }

    #[test]
    fn names_have_a_single_origin() {
        let (detector, encoder) = TEXT.split_at(TEXT.find("[encoder]").unwrap());
        let classes = format!("{detector}classes = ['bed']\n");
        assert_eq!(read(&classes).unwrap().detector.sure_score, 1.0);
        for text in [detector.to_owned(), format!("{classes}{encoder}")] {
            let error = read(&text).unwrap_err().to_string();
            assert!(error.contains("detector.classes or from [encoder]"), "{error}");
        }
    }

    #[test]
    fn invalid_values_are_named() {
        for (from, to, words) in [
            ("side_px = 640", "side_px = 4", "detector.side_px is 4, and must be from 8 to 2048"),
            ("least_score = 0.2", "least_score = 2.0", "detector.least_score is 2"),
            ("least_score = 0.2", "least_score = 0.2\nsure_score = 0", "detector.sure_score is 0"),
            ("std = [1.0, 1.0, 1.0]", "std = [1.0, 0.0, 1.0]", "detector.std is 0"),
            ("alike = [0.5, 0.9]", "alike = [0.5, 0.4]", "encoder.alike, second, is 0.4"),
            ("scale = 100.0", "", "missing field `scale`"),
        ] {
            let error = read(&TEXT.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(words) && error.contains("models.toml"), "{error}");
        }
    }

    #[test]
    fn text_embeddings_have_equal_lengths() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("words.json");
        fs::write(&path, r#"{"tv monitor": [3, 4], "bed": [0, 2]}"#).unwrap();
        let read = words(&path).unwrap();
        assert_eq!(read, [("bed".to_owned(), vec![0.0, 1.0]), ("tv_monitor".to_owned(), vec![0.6, 0.8])]);
        for (text, problem) in [("{}", "no embeddings"), (r#"{"a": [1], "b": [1, 2]}"#, "'b' has 2 numbers")]
        {
            fs::write(&path, text).unwrap();
            let error = words(&path).unwrap_err().to_string();
            assert!(error.contains(problem), "{error}");
        }
    }
}
