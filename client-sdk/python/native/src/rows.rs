//! Rows in NumPy memory: all unsafe code of this crate (README.md).

use avln_training::{ArrayKind, ArraySpec, Row, RowArray, RowSource};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// NumPy arrays with a row per environment.
pub(crate) struct Buffer {
    arrays: Vec<Column>,
    finals: Vec<Column>,
    /// Per row, true while a task writes to it.
    taken: Vec<AtomicBool>,
    /// Keeps the arrays alive.
    _owners: Vec<Py<PyAny>>,
}

/// An array's memory.
struct Column {
    address: usize,
    kind: ArrayKind,
    /// Elements per row.
    length: usize,
}

impl Column {
    /// Reads address and size of a writable, contiguous array with the wanted type and row length.
    fn new(array: &Bound<'_, PyAny>, spec: &ArraySpec, rows: usize) -> PyResult<Self> {
        let (code, bytes) = match spec.kind {
            ArrayKind::U8 => ("|u1", 1),
            ArrayKind::I32 => ("<i4", 4),
            ArrayKind::I64 => ("<i8", 8),
            ArrayKind::F32 => ("<f4", 4),
        };
        let interface = array.getattr("__array_interface__")?;
        let (address, is_read_only): (usize, bool) = interface.get_item("data")?.extract()?;
        let found: String = interface.get_item("typestr")?.extract()?;
        let is_contiguous = interface.get_item("strides")?.is_none();
        let size: usize = array.getattr("nbytes")?.extract()?;
        let fits = found == code && size == rows * spec.len() * bytes;
        if is_read_only || !is_contiguous || !fits || !address.is_multiple_of(bytes) {
            let message =
                format!("array '{}' must be writable, contiguous {code} with {rows} rows", spec.name);
            return Err(PyValueError::new_err(message));
        }
        Ok(Self { address, kind: spec.kind, length: spec.len() })
    }

    /// Returns a row.
    ///
    /// # Safety
    /// The row exists, `T` is the array's type, and no other slice of this row exists.
    #[expect(clippy::mut_from_ref, reason = "the memory belongs to NumPy, not to the column")]
    unsafe fn slice<T>(&self, row: usize) -> &mut [T] {
        let first = (self.address as *mut T).wrapping_add(row * self.length);
        // SAFETY: `Column::new` has checked that the address belongs to a writable, aligned array of this size, which `Buffer` keeps
        // alive; the caller guarantees the rest.
        unsafe { std::slice::from_raw_parts_mut(first, self.length) }
    }

    /// Returns a row with its type.
    ///
    /// # Safety
    /// The row exists, and no other slice of this row exists.
    unsafe fn array(&self, row: usize) -> RowArray<'_> {
        // SAFETY: the types match the kinds; the caller guarantees the rest.
        unsafe {
            match self.kind {
                ArrayKind::U8 => RowArray::U8(self.slice(row)),
                ArrayKind::I32 => RowArray::I32(self.slice(row)),
                ArrayKind::I64 => RowArray::I64(self.slice(row)),
                ArrayKind::F32 => RowArray::F32(self.slice(row)),
            }
        }
    }
}

impl Buffer {
    /// Checks the arrays; `finals` is empty, or has an array per entry too.
    pub(crate) fn new(
        specs: &[ArraySpec],
        arrays: &[Bound<'_, PyAny>],
        finals: &[Bound<'_, PyAny>],
        rows: usize,
    ) -> PyResult<Arc<Self>> {
        if arrays.len() != specs.len() || !(finals.is_empty() || finals.len() == specs.len()) {
            return Err(PyValueError::new_err("a buffer needs an array per entry of the layout"));
        }
        let columns = |arrays: &[Bound<'_, PyAny>]| {
            arrays
                .iter()
                .zip(specs)
                .map(|(array, spec)| Column::new(array, spec, rows))
                .collect::<PyResult<Vec<_>>>()
        };
        Ok(Arc::new(Self {
            arrays: columns(arrays)?,
            finals: columns(finals)?,
            taken: (0..rows).map(|_| AtomicBool::new(false)).collect(),
            _owners: arrays.iter().chain(finals).map(|array| array.clone().unbind()).collect(),
        }))
    }

    /// Reserves a row for a task.
    pub(crate) fn take(self: &Arc<Self>, row: usize) -> PyResult<NumpyRow> {
        let is_free = self.taken.get(row).is_some_and(|taken| !taken.swap(true, Ordering::AcqRel));
        if is_free {
            return Ok(NumpyRow { buffer: Arc::clone(self), row });
        }
        Err(PyValueError::new_err(format!("row {row} does not exist or belongs to a running step")))
    }
}

/// A reserved row; dropping it frees the row.
pub(crate) struct NumpyRow {
    buffer: Arc<Buffer>,
    pub(crate) row: usize,
}

impl Drop for NumpyRow {
    fn drop(&mut self) {
        self.buffer.taken[self.row].store(false, Ordering::Release);
    }
}

impl RowSource for NumpyRow {
    fn row(&mut self) -> Row<'_> {
        // SAFETY: `Buffer::take` has reserved the existing row for this value alone, which is borrowed mutably.
        Row { arrays: self.buffer.arrays.iter().map(|column| unsafe { column.array(self.row) }).collect() }
    }

    fn keep_final(&mut self) {
        for (from, to) in self.buffer.arrays.iter().zip(&self.buffer.finals) {
            // SAFETY: as in `row`; the arrays for final observations are other arrays.
            match unsafe { (from.array(self.row), to.array(self.row)) } {
                (RowArray::U8(from), RowArray::U8(to)) => to.copy_from_slice(from),
                (RowArray::I32(from), RowArray::I32(to)) => to.copy_from_slice(from),
                (RowArray::I64(from), RowArray::I64(to)) => to.copy_from_slice(from),
                (RowArray::F32(from), RowArray::F32(to)) => to.copy_from_slice(from),
                _ => {}
            }
        }
    }
}
