//! The door from outside: a real database, real requests, no network.

mod api;
mod boards;
mod door;
mod fixture;
mod freeze;
mod golden;
mod live;
mod management;
mod onlooker;
mod pages;
mod replay;
mod visibility;
