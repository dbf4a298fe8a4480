use crate::onnx::config::{ModelFile, ModelsError};
use avln_client::Image;
use ort::environment::Environment;
use ort::session::{Session, SessionOutputs};
use ort::value::Tensor;
use std::path::Path;
use std::sync::Mutex;

/// An image crop, in shares: left, top, right, bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CropBox(pub(crate) [f32; 4]);

impl CropBox {
    /// The whole image.
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

    /// Returns the columns at this image width.
    pub(crate) fn columns(self, width: usize) -> std::ops::Range<usize> {
        Self::span(self.0[0], self.0[2], width)
    }

    /// Returns the rows at this image height.
    pub(crate) fn rows(self, height: usize) -> std::ops::Range<usize> {
        Self::span(self.0[1], self.0[3], height)
    }

    /// Returns the middle half.
    pub(crate) fn middle(self) -> Self {
        let [left, top, right, bottom] = self.0;
        let (x, y) = (0.25 * (right - left), 0.25 * (bottom - top));
        Self([left + x, top + y, right - x, bottom - y])
    }
}

/// Converts a crop to a model input: planes of red, green and blue, row by row, resized to a square by bilinear
/// interpolation.
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

/// A model with an image input.
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

    /// Creates an error about an output.
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
