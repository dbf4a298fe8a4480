//! The class `NativeVector`.

use crate::options::VectorOptions;
use crate::rows::{Buffer, NumpyRow};
use avln_training::{EnvState, EpisodeSource, Finished, TrainingError, VectorEnv};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Pause between checks for Ctrl-C.
const SIGNALS: Duration = Duration::from_millis(50);

/// Name, type, shape, and whether the array is privileged information.
type ArrayEntry = (String, &'static str, Vec<usize>, bool);

/// Environment, row, reward, terminated, truncated, and an error message.
type StepResult = (usize, usize, f64, bool, bool, Option<String>);

/// View, map, and places as JSON.
type OverviewParts<'py> = (Bound<'py, PyBytes>, Bound<'py, PyBytes>, String);

/// Environments on worker threads, with observations in NumPy arrays.
#[pyclass(frozen)]
pub(crate) struct NativeVector {
    vector: Mutex<Option<VectorEnv<NumpyRow>>>,
    buffers: Mutex<Vec<Arc<Buffer>>>,
    /// Results that an interrupted `recv` has left.
    received: Mutex<Vec<StepResult>>,
    /// True from the start of a task until `recv` returns the result. Python code can be interrupted between two calls.
    is_running: Mutex<Vec<bool>>,
    process: u32,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn value_error(error: TrainingError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

#[pymethods]
impl NativeVector {
    /// Starts the threads; `options` is JSON.
    #[new]
    fn new(py: Python<'_>, options: &str) -> PyResult<Self> {
        let options = VectorOptions::from_json(options)?;
        let (source, env, audio) = (options.source()?, options.env()?, options.audio()?);
        let (count, threads) = (options.num_envs, options.threads);
        let vector = py.detach(|| VectorEnv::new(count, threads, EpisodeSource::open(&source)?, env, audio));
        Ok(Self {
            vector: Mutex::new(Some(vector.map_err(value_error)?)),
            buffers: Mutex::default(),
            received: Mutex::default(),
            is_running: Mutex::new(vec![false; count]),
            process: std::process::id(),
        })
    }

    /// Returns name, type, shape and privilege of all arrays.
    fn layout(&self) -> PyResult<Vec<ArrayEntry>> {
        self.with(|vector| {
            let entry = |spec: &avln_training::ArraySpec| {
                let kind = match spec.kind {
                    avln_training::ArrayKind::U8 => "uint8",
                    avln_training::ArrayKind::I32 => "int32",
                    avln_training::ArrayKind::I64 => "int64",
                    avln_training::ArrayKind::F32 => "float32",
                };
                (spec.name.to_owned(), kind, spec.shape.clone(), spec.is_info)
            };
            Ok(vector.layout().arrays().iter().map(entry).collect())
        })
    }

    /// Returns the largest depth in metres, and the largest number of steps per episode.
    fn limits(&self) -> PyResult<(f32, u32)> {
        self.with(|vector| {
            let rules = &vector.options().rules;
            Ok((rules.depth_max_m, rules.max_steps))
        })
    }

    /// Returns the name of the observation's definition.
    fn observation_digest(&self) -> PyResult<String> {
        self.with(|vector| Ok(vector.layout().digest(vector.options())))
    }

    /// Registers arrays with a row per environment, in the layout's order; returns the buffer's number.
    fn add_buffer(
        &self,
        arrays: Vec<Bound<'_, PyAny>>,
        finals: Vec<Bound<'_, PyAny>>,
        rows: usize,
    ) -> PyResult<usize> {
        let specs = self.with(|vector| Ok(vector.layout().arrays().to_vec()))?;
        let mut buffers = lock(&self.buffers);
        buffers.push(Buffer::new(&specs, &arrays, &finals, rows)?);
        Ok(buffers.len() - 1)
    }

    /// Starts a step of each environment, written to the given rows.
    fn send_steps(
        &self,
        envs: Vec<usize>,
        actions: Vec<i64>,
        buffer: usize,
        rows: Vec<usize>,
    ) -> PyResult<()> {
        // All rows before the first step: an error must leave no step behind.
        let rows: Vec<_> = rows.into_iter().map(|row| self.row(buffer, row)).collect::<PyResult<_>>()?;
        for ((env, action), row) in envs.into_iter().zip(actions).zip(rows) {
            self.start(env, |vector| vector.send_step(env, action, row))?;
        }
        Ok(())
    }

    /// Starts the next episode of each environment.
    fn send_resets(&self, envs: Vec<usize>, buffer: usize, rows: Vec<usize>) -> PyResult<()> {
        let rows: Vec<_> = rows.into_iter().map(|row| self.row(buffer, row)).collect::<PyResult<_>>()?;
        for (env, row) in envs.into_iter().zip(rows) {
            self.start(env, |vector| vector.send_reset(env, row))?;
        }
        Ok(())
    }

    /// Starts the restoration of a state from `state`.
    fn send_restore(&self, env: usize, state: &[u8], buffer: usize, row: usize) -> PyResult<()> {
        let state: EnvState = serde_json::from_slice(state)
            .map_err(|error| PyValueError::new_err(format!("cannot restore the state: {error}")))?;
        let row = self.row(buffer, row)?;
        self.start(env, |vector| vector.send_restore(env, state, row))
    }

    /// Returns for each environment whether `recv` has a result to return, now or later.
    fn running(&self) -> PyResult<Vec<bool>> {
        self.with(|_| Ok(lock(&self.is_running).clone()))
    }

    /// Waits for `count` results. After Ctrl-C the results remain for the next call.
    fn recv(&self, py: Python<'_>, count: usize) -> PyResult<Vec<StepResult>> {
        loop {
            let mut received = lock(&self.received);
            if received.len() >= count {
                let results: Vec<StepResult> = received.drain(..count).collect();
                let mut is_running = lock(&self.is_running);
                results.iter().for_each(|result| is_running[result.0] = false);
                return Ok(results);
            }
            let missing = count - received.len();
            drop(received);
            let recv = || self.with(|vector| Ok(vector.recv(missing, SIGNALS)));
            let next = py.detach(recv)?;
            lock(&self.received).extend(next.into_iter().map(result));
            py.check_signals()?;
        }
    }

    /// Returns the exact state of an environment.
    fn state(&self, env: usize) -> PyResult<Vec<u8>> {
        let state = self.with(|vector| vector.state(env).map_err(value_error))?;
        serde_json::to_vec(&state).map_err(|error| PyRuntimeError::new_err(error.to_string()))
    }

    /// Returns the parts of a picture: view, map, and places as JSON.
    fn overview<'py>(&self, py: Python<'py>, env: usize, side: u32) -> PyResult<OverviewParts<'py>> {
        let overview = py.detach(|| self.with(|vector| vector.overview(env, side).map_err(value_error)))?;
        let json =
            serde_json::to_string(&overview).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
        Ok((PyBytes::new(py, &overview.view), PyBytes::new(py, &overview.map), json))
    }

    /// Ends all threads after their present step; further calls fail.
    fn close(&self, py: Python<'_>) {
        // In a forked child, a thread that does not exist there may hold the lock for ever.
        if self.is_own() {
            let vector = lock(&self.vector).take();
            py.detach(|| drop(vector));
        }
    }
}

impl NativeVector {
    fn with<T>(&self, call: impl FnOnce(&VectorEnv<NumpyRow>) -> PyResult<T>) -> PyResult<T> {
        if !self.is_own() {
            let message = "the environments belong to the parent process; create them after the fork";
            return Err(PyRuntimeError::new_err(message));
        }
        let vector = lock(&self.vector);
        call(vector.as_ref().ok_or_else(|| PyRuntimeError::new_err("the environments are closed"))?)
    }

    /// Starts a task of an environment.
    fn start(
        &self,
        env: usize,
        send: impl FnOnce(&VectorEnv<NumpyRow>) -> Result<(), TrainingError>,
    ) -> PyResult<()> {
        self.with(|vector| send(vector).map_err(value_error))?;
        lock(&self.is_running)[env] = true;
        Ok(())
    }

    fn row(&self, buffer: usize, row: usize) -> PyResult<NumpyRow> {
        let buffer = lock(&self.buffers).get(buffer).cloned();
        buffer.ok_or_else(|| PyValueError::new_err("no such buffer"))?.take(row)
    }

    /// Returns false in a forked child.
    fn is_own(&self) -> bool {
        std::process::id() == self.process
    }
}

impl Drop for NativeVector {
    fn drop(&mut self) {
        // A forked child has no worker threads to wait for.
        if !self.is_own() {
            let vector = self.vector.get_mut().unwrap_or_else(PoisonError::into_inner);
            std::mem::forget(vector.take());
        }
    }
}

fn result(finished: Finished<NumpyRow>) -> StepResult {
    let (env, row) = (finished.env, finished.row.row);
    match finished.flags {
        Ok(flags) => (env, row, flags.reward, flags.terminated, flags.truncated, None),
        Err(error) => (env, row, 0.0, false, false, Some(error.to_string())),
    }
}
