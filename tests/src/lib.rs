//! What only the whole house can show: the tests lie in `tests/`.
