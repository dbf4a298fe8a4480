//! Integration tests of the web application: a real database and real requests, mostly without a network.

mod api;
mod documents;
mod fixture;
mod golden;
mod live;
mod management;
mod pages;
mod replay;
mod site;
