//! The gRPC server with a toy host, tested by real clients over real connections.

mod common;
mod endings;
mod hostile;
mod play;
mod random_clients;
mod resume;
mod services;
mod spans;
