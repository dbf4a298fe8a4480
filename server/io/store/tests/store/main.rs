//! The store on a real file: round trips, transactions, crashes, foreign files and what each viewer may see.

mod backup;
mod board;
mod challenge;
mod fixture;
mod opening;
mod play;
mod prune;
mod quota;
mod rescore;
mod rulings;
mod schema;
mod start;
mod uptime;
mod visibility;
