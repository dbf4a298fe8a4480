use serde::Deserialize;
use std::{collections::BTreeMap, fs, io, path::Path, path::PathBuf};

/// Sides of the square pictures that models may take, pixels.
const SIDES_PX: [usize; 2] = [8, 2048];

/// What a file of models says; paths in it are seen from where it lies.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Models {
    /// The library of ONNX Runtime.
    pub(crate) runtime: PathBuf,
    pub(crate) detector: Detector,
    pub(crate) encoder: Encoder,
}

/// Finds things.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Detector {
    #[serde(flatten)]
    pub(crate) model: ModelFile,
    /// Score from which on a box is a thing.
    pub(crate) least_score: f32,
}

/// Tells what they are.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Encoder {
    #[serde(flatten)]
    pub(crate) model: ModelFile,
    /// JSON file with the embedding of each word that things are called by.
    pub(crate) words: PathBuf,
    /// What cosines of pictures and words are multiplied by before they become likelihoods.
    pub(crate) scale: f32,
    /// Cosines of the embeddings of things that are unlike and alike.
    pub(crate) alike: [f32; 2],
}

/// A model, and the pictures that it takes.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct ModelFile {
    pub(crate) file: PathBuf,
    pub(crate) side_px: usize,
    /// Taken from red, green and blue, which go from 0 to 1, before they are divided by `std`.
    pub(crate) mean: [f32; 3],
    pub(crate) std: [f32; 3],
}

/// Why models cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ModelsError {
    /// The file of models, or that of words, cannot be read.
    #[error("cannot read {}: {error}", path.display())]
    Unreadable {
        /// Of the file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// A file does not say what it must.
    #[error("{}: {problem}; docs/models.md has an example", path.display())]
    Malformed {
        /// Of the file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// ONNX Runtime cannot be loaded.
    #[error(
        "cannot load ONNX Runtime from {}: {problem}; `pip install onnxruntime` brings it, and `runtime` must name its \
         libonnxruntime.so",
        path.display()
    )]
    Runtime {
        /// Of the library.
        path: PathBuf,
        /// Why.
        problem: String,
    },
    /// A model cannot be loaded, or does not give what it must.
    #[error("model {}: {problem}; docs/models.md tells what models take and give", path.display())]
    Model {
        /// Of the model.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
}

impl Models {
    /// What a file says, with paths as seen from here.
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

/// The words of a file, each with its embedding of length 1.
pub(crate) fn words(path: &Path) -> Result<Vec<(String, Vec<f32>)>, ModelsError> {
    let words: BTreeMap<String, Vec<f32>> =
        serde_json::from_str(&text(path)?).map_err(|error| malformed(path, &error.to_string()))?;
    let length = words.values().next().map_or(0, Vec::len);
    if length == 0 {
        return Err(malformed(path, "it has no embeddings"));
    }
    let unlike = words.iter().find(|(_, embedding)| embedding.len() != length);
    if let Some((word, embedding)) = unlike {
        let problem = format!("the embedding of '{word}' has {} numbers, others {length}", embedding.len());
        return Err(malformed(path, &problem));
    }
    Ok(words.into_iter().map(|(word, embedding)| (word.replace(' ', "_"), unit(&embedding))).collect())
}

/// The same direction with length 1.
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
    fn paths_are_seen_from_the_file() {
        let models = read(TEXT).unwrap();
        assert!(models.detector.model.file.is_absolute() && models.runtime.ends_with("libonnxruntime.so"));
        assert_eq!(models.encoder.model.file, Path::new("/models/encoder.onnx"));
    }

    #[test]
    fn the_example_of_the_documents_can_be_read() {
        let models = read(include_str!("../../../docs/models.toml")).unwrap();
        assert_eq!((models.detector.model.side_px, models.encoder.model.side_px), (640, 224));
    }

    #[test]
    fn what_cannot_be_is_named() {
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
    fn words_have_embeddings_of_one_length() {
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
