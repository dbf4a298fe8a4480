//! What stands above every page. One text for the whole process, as there is one server in it.

use std::sync::{PoisonError, RwLock};

static NOTICE: RwLock<String> = RwLock::new(String::new());

/// Puts `text` above every page from now on; an empty one takes it away.
pub fn announce(text: &str) {
    text.clone_into(&mut NOTICE.write().unwrap_or_else(PoisonError::into_inner));
}

/// What stands above every page; empty: nothing.
pub(crate) fn notice() -> String {
    NOTICE.read().unwrap_or_else(PoisonError::into_inner).clone()
}
