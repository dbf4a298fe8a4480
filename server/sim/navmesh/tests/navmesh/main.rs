//! What a navmesh promises, checked against distances worked by hand and against brute force.

mod broken;
mod build;
mod detour;
mod flat;
mod houses;
mod oracle;
mod storeys;
