//! The door from outside: a real database, real requests, no network.

mod api;
mod boards;
mod door;
mod fixture;
mod freeze;
mod golden;
mod live;
mod office;
mod onlooker;
mod pages;
mod replay;
mod visibility;
