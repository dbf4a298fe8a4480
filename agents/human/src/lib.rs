//! A person as an agent: this program plays a run as every agent does, and asks a person in a browser on this machine what to do.
//! The person gets what agents get, within the same budgets, and the same referee judges it.
//!
//! Start reading at [`run`]: `game` plays, `door` shows the page, `message` is what goes between them.
//!
//! *Never*: tells the person anything that an agent is not told; links anything of the server.

mod door;
mod game;
mod message;
mod options;

pub use options::{HumanError, Options, run, run_with};
