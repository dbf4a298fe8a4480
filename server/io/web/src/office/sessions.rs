use avln_store::{TokenHash, Viewer};
use std::{
    collections::BTreeMap,
    fmt,
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// A session ends when nobody used it for this long: a page that was left open in a shared room.
const IDLE: Duration = Duration::from_secs(2 * 3600);
/// A session ends after this in any case: one working day.
const LIFE: Duration = Duration::from_secs(12 * 3600);
/// Sessions of one team, or of all organisers: many people with several browsers each. The one unused for longest gives way.
const MOST_OF_ONE: usize = 64;
/// Sessions in all, some 2 MiB of memory. The one unused for longest gives way.
const MOST: usize = 4096;

/// Who is signed in. A session is known by the hash of its cookie, so that nothing in here opens anything.
#[derive(Default)]
pub(crate) struct Sessions(Mutex<BTreeMap<Key, Session>>);

type Key = [u8; 32];

struct Session {
    token: TokenHash,
    viewer: Viewer,
    begun: Instant,
    used: Instant,
    /// What the visitor is told on the next page.
    said: Option<String>,
}

impl Session {
    fn is_over(&self, now: Instant) -> bool {
        let since = |moment| now.saturating_duration_since(moment);
        since(self.used) >= IDLE || since(self.begun) >= LIFE
    }
}

impl fmt::Debug for Sessions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Sessions({})", self.all().len())
    }
}

fn key(id: &str) -> Key {
    *blake3::hash(id.as_bytes()).as_bytes()
}

/// What every form of a session carries. It tells nothing of the cookie that it is made from.
pub(crate) fn form_key(id: &str) -> blake3::Hash {
    blake3::Hash::from_bytes(blake3::derive_key("LH-AVLN Arena: key of a session's forms", id.as_bytes()))
}

impl Sessions {
    fn all(&self) -> MutexGuard<'_, BTreeMap<Key, Session>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a session of who holds `token`; gives back its random id.
    ///
    /// # Errors
    /// When the system has no randomness to give.
    pub(crate) fn begin(
        &self,
        token: TokenHash,
        viewer: Viewer,
        now: Instant,
    ) -> Result<String, getrandom::Error> {
        let mut bytes = [0_u8; 32];
        getrandom::fill(&mut bytes)?;
        let id: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        let mut all = self.all();
        all.retain(|_, session| !session.is_over(now));
        make_room(&mut all, MOST_OF_ONE, |session| session.viewer == viewer);
        make_room(&mut all, MOST, |_| true);
        all.insert(key(&id), Session { token, viewer, begun: now, used: now, said: None });
        Ok(id)
    }

    /// The token with which a session began; `None` when there is no such session any more.
    pub(crate) fn find(&self, id: &str, now: Instant) -> Option<TokenHash> {
        let mut all = self.all();
        let key = key(id);
        let session = all.get_mut(&key)?;
        if session.is_over(now) {
            all.remove(&key);
            return None;
        }
        session.used = now;
        Some(session.token.clone())
    }

    /// Ends a session.
    pub(crate) fn end(&self, id: &str) {
        self.all().remove(&key(id));
    }

    /// Notes what the visitor is told on the next page.
    pub(crate) fn say(&self, id: &str, words: String) {
        if let Some(session) = self.all().get_mut(&key(id)) {
            session.said = Some(words);
        }
    }

    /// What was noted, once.
    pub(crate) fn said(&self, id: &str) -> Option<String> {
        self.all().get_mut(&key(id))?.said.take()
    }
}

/// Ends the sessions among `these` that were unused for longest, so that one more is no more than `most`.
fn make_room(all: &mut BTreeMap<Key, Session>, most: usize, these: impl Fn(&Session) -> bool) {
    while all.values().filter(|session| these(session)).count() >= most {
        let oldest = all.iter().filter(|(_, session)| these(session)).min_by_key(|(_, session)| session.used);
        let Some(key) = oldest.map(|(key, _)| *key) else { return };
        all.remove(&key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn begin(sessions: &Sessions, team: &str, now: Instant) -> String {
        sessions.begin(TokenHash::of(team), Viewer::Team(team.to_owned()), now).expect("randomness")
    }

    #[test]
    fn a_session_ends_when_it_is_not_used_or_old() {
        let (sessions, start) = (Sessions::default(), Instant::now());
        let id = begin(&sessions, "red", start);
        assert_eq!(id.len(), 64);
        let second = Duration::from_secs(1);
        assert_eq!(sessions.find(&id, start + IDLE - second), Some(TokenHash::of("red")));
        assert!(sessions.find(&id, start + 2 * IDLE - 2 * second).is_some(), "it was used meanwhile");
        assert_eq!(sessions.find(&id, start + 3 * IDLE), None);
        assert_eq!(sessions.find(&id, start), None, "it is gone");
        let old = begin(&sessions, "red", start);
        let mut now = start;
        while now + IDLE < start + LIFE {
            now += IDLE - second;
            assert!(sessions.find(&old, now).is_some());
        }
        assert_eq!(sessions.find(&old, start + LIFE), None);
    }

    #[test]
    fn a_session_that_was_ended_is_over_and_others_are_not() {
        let (sessions, now) = (Sessions::default(), Instant::now());
        let [one, other] = [begin(&sessions, "red", now), begin(&sessions, "red", now)];
        assert_ne!(one, other);
        sessions.end(&one);
        assert_eq!((sessions.find(&one, now), sessions.find(&other, now).is_some()), (None, true));
        assert_eq!(sessions.find("", now), None);
    }

    #[test]
    fn nobody_crowds_the_others_out() {
        let (sessions, start) = (Sessions::default(), Instant::now());
        let organiser = sessions.begin(TokenHash::of("o"), Viewer::Organiser, start).expect("randomness");
        let moment = |index: usize| start + Duration::from_millis(index as u64);
        let many: Vec<String> =
            (0..=MOST_OF_ONE).map(|index| begin(&sessions, "red", moment(index))).collect();
        let now = moment(MOST_OF_ONE);
        assert_eq!(sessions.find(&many[0], now), None, "the oldest of the team gave way");
        assert!(sessions.find(&many[1], now).is_some() && sessions.find(&organiser, now).is_some());
        for index in 0..MOST {
            begin(&sessions, &format!("team {index}"), now + Duration::from_secs(1));
        }
        assert_eq!(sessions.all().len(), MOST);
    }

    #[test]
    fn what_is_said_is_told_once_and_forms_have_the_key_of_their_session() {
        let (sessions, now) = (Sessions::default(), Instant::now());
        let id = begin(&sessions, "red", now);
        sessions.say(&id, "done".to_owned());
        assert_eq!((sessions.said(&id), sessions.said(&id)), (Some("done".to_owned()), None));
        assert_eq!(form_key(&id), form_key(&id));
        assert_ne!(form_key(&id), form_key("other"));
        assert!(!format!("{sessions:?}").contains(&id));
    }
}
