use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Sides of the square model inputs, pixels.
const SIDES_PX: [usize; 2] = [8, 2048];

/// The model configuration; relative paths start at its folder.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Models {
    /// ONNX Runtime library path.
    pub(crate) runtime: PathBuf,
    pub(crate) detector: Detector,
    pub(crate) encoder: Encoder,
}

/// The detector.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Detector {
    #[serde(flatten)]
    pub(crate) model: ModelFile,
    /// Least detection score.
    pub(crate) least_score: f32,
}

/// The image encoder.
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

/// A model and the input format.
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
        for file in [
            &mut models.runtime,
            &mut models.detector.model.file,
            &mut models.encoder.model.file,
            &mut models.encoder.words,
        ] {
            *file = folder.join(&*file);
        }
        models.check().map_err(|problem| malformed(path, &problem))?;
        Ok(models)
    }

    fn check(&self) -> Result<(), String> {
        self.detector.model.check("detector")?;
        self.encoder.model.check("encoder")?;
        within("detector.least_score", self.detector.least_score, 0.0, 1.0)?;
        within("encoder.scale", self.encoder.scale, 0.1, 1000.0)?;
        let [unlike, alike] = self.encoder.alike;
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

/// Scales a vector to length 1.
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
        assert_eq!(models.encoder.model.file, Path::new("/models/encoder.onnx"));
    }

    #[test]
    fn documented_example_is_valid() {
        let models = read(include_str!("../../../../docs/models.toml")).unwrap();
        assert_eq!((models.detector.model.side_px, models.encoder.model.side_px), (640, 224));
    }

    #[test]
    fn invalid_values_are_named() {
        for (from, to, words) in [
            ("side_px = 640", "side_px = 4", "detector.side_px is 4, and must be from 8 to 2048"),
            ("least_score = 0.2", "least_score = 2.0", "detector.least_score is 2"),
            ("std = [1.0, 1.0, 1.0]", "std = [1.0, 0.0, 1.0]", "detector.std is 0"),
            ("alike = [0.5, 0.9]", "alike = [0.5, 0.4]", "encoder.alike, second, is 0.4"),
            ("scale = 100.0", "", "missing field `scale`"),
        ] {
            let error = read(&TEXT.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(words) && error.contains("models.toml"), "{error}");
        }
    }

    #[test]
    fn word_embeddings_have_equal_lengths() {
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
