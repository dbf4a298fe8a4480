use crate::{CellError, Plan, namespaces};
use nix::sys::{prctl::set_pdeathsig, signal::Signal};
use std::{
    os::unix::process::ExitStatusExt,
    path::Path,
    process::{Command, ExitStatus},
};

pub(crate) fn enter(plan: &Path, program: &Path, inmate_arguments: &[String]) -> Result<u8, CellError> {
    Plan::read(plan)?;
    let mut inmate = Command::new(program);
    inmate.args(inmate_arguments);
    if let Err(why) = namespaces::take() {
        inmate.arg("--outside").arg(why);
    }
    // If the supervisor is killed, the agent and all its processes die as well.
    let _ = set_pdeathsig(Signal::SIGKILL);
    let status = inmate.status().map_err(|error| CellError::Command {
        program: program.display().to_string(),
        problem: error.to_string(),
    })?;
    Ok(code(status))
}

fn code(status: ExitStatus) -> u8 {
    let code = status.code().unwrap_or_else(|| 128 + status.signal().unwrap_or(0));
    u8::try_from(code).unwrap_or(u8::MAX)
}
