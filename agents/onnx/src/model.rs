use crate::config::{ModelFile, ModelsError};
use crate::crop::{Frame, planes};
use avln_client::Image;
use ort::{
    environment::Environment,
    session::{Session, SessionOutputs},
    value::Tensor,
};
use std::{path::Path, sync::Mutex};

/// ONNX Runtime is loaded once in a process.
static RUNTIME: Mutex<Option<Environment>> = Mutex::new(None);

/// A model that takes one picture.
pub(crate) struct Model {
    about: ModelFile,
    session: Session,
}

/// Numbers that a model gave, and their shape.
pub(crate) type Numbers = (Vec<usize>, Vec<f32>);

impl Model {
    /// Loads a model, and ONNX Runtime from `library` where it is not there yet. It takes one thread.
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

    /// What it gives for a frame of a picture: its first `N` outputs.
    pub(crate) fn run<const N: usize>(
        &mut self,
        image: &Image,
        frame: Frame,
    ) -> Result<[Numbers; N], ModelsError> {
        let side = self.about.side_px;
        let fail = |problem: String| ModelsError::Model { path: self.about.file.clone(), problem };
        let tensor = Tensor::from_array(([1, 3, side, side], planes(image, frame, &self.about)));
        let tensor = tensor.map_err(|error| fail(error.to_string()))?;
        let given = self.session.run(ort::inputs![tensor]).map_err(|error| fail(error.to_string()))?;
        if given.len() < N {
            return Err(fail(format!("it gives {} outputs, and must give {N}", given.len())));
        }
        let mut outputs = [(); N].map(|()| Numbers::default());
        for (index, output) in outputs.iter_mut().enumerate() {
            *output = numbers(&given, index).map_err(&fail)?;
        }
        Ok(outputs)
    }

    /// An error about what it gave.
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
        .map_err(|error| format!("its output {index} is no tensor of f32: {error}"))?;
    let shape = shape.iter().map(|&side| usize::try_from(side).unwrap_or(0)).collect();
    match values.iter().all(|value| value.is_finite()) {
        true => Ok((shape, values.to_vec())),
        false => Err(format!("its output {index} has numbers that are not finite")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_onnx_runtime_it_says_what_to_install() {
        let refusal =
            runtime(Path::new("absent/libonnxruntime.so")).expect_err("nothing is there").to_string();
        assert!(refusal.contains("absent/libonnxruntime.so") && refusal.contains("pip install onnxruntime"));
    }
}
