//! What a navmesh promises, checked against distances worked by hand and against brute force.

mod broken;
mod build;
mod detour;
mod exits;
mod flat;
mod habitat;
mod houses;
mod oracle;
mod storeys;
