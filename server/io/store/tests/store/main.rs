//! The store on a real file: results, transactions, crashes, foreign files, upgrades and visibility.

mod fixture;
mod leaderboard;
mod opening;
mod phases;
mod play;
mod quota;
mod views;
