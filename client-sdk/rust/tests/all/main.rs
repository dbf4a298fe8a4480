//! Tests against scripted servers.

mod conversation;
mod fake;
mod services;
