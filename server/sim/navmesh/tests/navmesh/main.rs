//! Navmesh tests against hand-computed distances and brute force.

mod broken;
mod build;
mod detour;
mod exits;
mod flat;
mod habitat;
mod houses;
mod oracle;
mod storeys;
