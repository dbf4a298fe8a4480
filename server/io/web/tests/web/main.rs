//! The door from outside: a real database, real requests, no network.

mod api;
mod door;
mod fixture;
mod pages;
mod visibility;
