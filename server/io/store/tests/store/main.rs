//! The store on a real file: round trips, transactions, crashes, foreign files and what each viewer may see.

mod board;
mod fixture;
mod opening;
mod play;
mod schema;
mod start;
mod visibility;
