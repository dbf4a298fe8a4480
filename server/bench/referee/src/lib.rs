//! Runs one episode: legal actions, budgets, alternation of sounds, building observations.
