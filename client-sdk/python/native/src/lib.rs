//! The Python module `avln.sim._native`; `avln.sim` is its documented interface.

mod options;
mod rows;
mod vector;

use pyo3::prelude::*;

/// Training environments on worker threads.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<vector::NativeVector>()?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))
}
