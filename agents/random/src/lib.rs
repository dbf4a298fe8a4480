//! The random agent: the floor of every leaderboard.
