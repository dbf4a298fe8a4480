//! Perception by ONNX models that people bring, for scenes that the arena's own network does not know: a detector finds things,
//! an encoder of pictures that shares its space with words (CLIP, SigLIP) tells what they are.
//!
//! Start reading at [`Brought`]. `docs/models.md` tells what models must take and give.
//!
//! *Never*: comes with a model, or with ONNX Runtime, which is loaded when it is asked for; links anything of the server.

mod brought;
mod config;
mod crop;
mod model;

pub use brought::{Brought, Failure};
pub use config::ModelsError;
