//! One body moving in one building, one step at a time.
