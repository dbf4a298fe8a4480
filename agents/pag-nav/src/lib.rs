//! PAG-Nav: the reference agent, a client like everyone else.
