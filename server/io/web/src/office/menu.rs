use std::future::Future;

tokio::task_local! {
    static MENU: Menu;
}

/// What the menu of a page offers beside what is for everybody.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Menu {
    /// Nothing: nobody can sign in here.
    #[default]
    Plain,
    /// To sign in.
    Stranger,
    /// The page of the visitor's team.
    Team,
    /// The organiser's pages.
    Organiser,
}

impl Menu {
    /// The menu of the visitor who is answered.
    pub(crate) fn current() -> Self {
        MENU.try_with(|menu| *menu).unwrap_or_default()
    }

    /// Answers a visitor who has this menu.
    pub(crate) async fn during<T>(self, answer: impl Future<Output = T>) -> T {
        MENU.scope(self, answer).await
    }

    /// The same for what is written at once.
    pub(crate) fn around<T>(self, write: impl FnOnce() -> T) -> T {
        MENU.sync_scope(self, write)
    }

    /// Where its entry leads, and its words.
    pub(crate) fn link(self) -> Option<(&'static str, &'static str)> {
        match self {
            Self::Plain => None,
            Self::Stranger => Some(("/sign-in", "Sign in")),
            Self::Team => Some(("/me", "My page")),
            Self::Organiser => Some(("/organise", "Organise")),
        }
    }
}
