//! Who asks, and for what.

use crate::{office::SignedIn, pages::segment, trouble::Trouble};
use avln_store::{CompareView, Incomparable, Reader, RunList, Viewer};
use axum::{
    extract::{FromRequestParts, Query},
    http::{header, request::Parts},
};
use serde::{Deserialize, de::DeserializeOwned};
use std::{
    convert::Infallible,
    fmt,
    time::{SystemTime, UNIX_EPOCH},
};

/// A visitor with the reading half of the store.
pub(crate) struct Visit {
    pub(crate) reader: Reader,
    pub(crate) viewer: Viewer,
    /// When the visitor asks, milliseconds since 1970-01-01 UTC.
    pub(crate) now_unix_ms: i64,
}

impl FromRequestParts<Reader> for Visit {
    type Rejection = Trouble;

    async fn from_request_parts(parts: &mut Parts, reader: &Reader) -> Result<Self, Trouble> {
        let now_unix_ms = now_unix_ms();
        let viewer = match parts.headers.get(header::AUTHORIZATION) {
            None => {
                let signed = parts.extensions.get::<SignedIn>();
                signed.map_or(Viewer::Anonymous, |signed| signed.holder.viewer.clone())
            }
            Some(value) => {
                let secret = value.to_str().ok().and_then(bearer).ok_or(Trouble::BadToken)?;
                reader.viewer(secret, now_unix_ms).await?.ok_or(Trouble::BadToken)?
            }
        };
        Ok(Self { reader: reader.clone(), viewer, now_unix_ms })
    }
}

/// The secret of an `Authorization` header of the kind `Bearer`.
fn bearer(value: &str) -> Option<&str> {
    let (scheme, secret) = value.split_once(' ')?;
    (scheme.eq_ignore_ascii_case("bearer") && secret.len() <= 512).then(|| secret.trim())
}

pub(crate) fn now_unix_ms() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}

/// The agents' door.
#[derive(Clone, Copy, Default)]
pub(crate) struct AgentsDoor {
    pub(crate) port: u16,
    /// Whether it speaks TLS.
    pub(crate) is_secure: bool,
}

/// Where agents connect: the name under which the visitor knows this machine, with the port of the agents' door.
pub(crate) struct Host {
    name: String,
    door: AgentsDoor,
}

impl fmt::Display for Host {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scheme = if self.door.is_secure { "https" } else { "http" };
        write!(f, "{scheme}://{}:{}", self.name, self.door.port)
    }
}

impl<S: Sync> FromRequestParts<S> for Host {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        let value = parts.headers.get(header::HOST).and_then(|value| value.to_str().ok());
        let door = parts.extensions.get().copied().unwrap_or_default();
        Ok(Self { name: value.and_then(host).unwrap_or("127.0.0.1").to_owned(), door })
    }
}

/// The name in a `Host` header; `None` when it is none that a shell would take as one word.
fn host(value: &str) -> Option<&str> {
    let name = value.rsplit_once(':').map_or(value, |(name, _)| name);
    let plain = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '.' | '-');
    (!name.is_empty() && name.len() <= 253 && name.chars().all(plain)).then_some(name)
}

/// The part of the address behind `?`; words that are not known are refused.
pub(crate) struct Asked<T>(pub(crate) T);

impl<T: DeserializeOwned, S: Sync> FromRequestParts<S> for Asked<T> {
    type Rejection = Trouble;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Trouble> {
        match Query::<T>::try_from_uri(&parts.uri) {
            Ok(Query(asked)) => Ok(Self(asked)),
            Err(error) => Err(Trouble::Invalid(error.body_text())),
        }
    }
}

/// Nothing may be asked.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Nothing {}

/// Which two runs are to be compared.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CompareQuery {
    pub(crate) first: String,
    pub(crate) second: String,
}

impl CompareQuery {
    /// Both runs side by side.
    pub(crate) async fn view(&self, visit: &Visit) -> Result<CompareView, Trouble> {
        let (first, second) = (self.first.as_str(), self.second.as_str());
        match visit.reader.compare(&visit.viewer, [first, second]).await? {
            Some(Ok(view)) => Ok(view),
            Some(Err(Incomparable::Apart)) => Err(Trouble::Invalid(format!(
                "the runs '{first}' and '{second}' cannot be compared: they are of different phases or orders of goals"
            ))),
            Some(Err(Incomparable::Hidden)) => Err(Trouble::Invalid(format!(
                "the runs '{first}' and '{second}' cannot be compared: their phase hides what single episodes were worth"
            ))),
            None => Err(Trouble::Unknown { what: "pair of runs", name: format!("{first} and {second}") }),
        }
    }
}

/// Which moment of a replay is asked for.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReplayQuery {
    /// The step; the last one when nothing is said.
    pub(crate) t: Option<u32>,
    /// The storey in front, from 1; the one that the body is on when nothing is said.
    pub(crate) storey: Option<usize>,
    /// Whether levels are told, for which the episode is heard again.
    ears: Option<Ears>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Ears {
    On,
}

impl ReplayQuery {
    /// Whether the episode is to be heard again.
    pub(crate) fn listens(self) -> bool {
        self.ears == Some(Ears::On)
    }
}

/// Which picture of a step is asked for.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PictureQuery {
    sensor: Option<PictureSensor>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum PictureSensor {
    Rgb,
    Depth,
}

impl PictureQuery {
    /// Whether depth is wanted instead of colours.
    pub(crate) fn is_depth(self) -> bool {
        self.sensor == Some(PictureSensor::Depth)
    }
}

/// Which runs are asked for.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RunsQuery {
    pub(crate) phase: Option<String>,
    /// The run after which the list goes on.
    pub(crate) before: Option<String>,
    pub(crate) limit: Option<u32>,
}

impl RunsQuery {
    /// Runs in a list when nothing is said, and the most that may be asked for.
    pub(crate) const LIMITS: (u32, u32) = (50, 200);

    /// How many runs are wanted.
    pub(crate) fn limit(&self) -> Result<u32, Trouble> {
        let (usual, most) = Self::LIMITS;
        match self.limit.unwrap_or(usual) {
            limit if (1..=most).contains(&limit) => Ok(limit),
            limit => Err(Trouble::Invalid(format!("limit is {limit} and must be 1 to {most}"))),
        }
    }

    /// The query of the same list, from the run on that comes after `before`.
    pub(crate) fn address(&self, before: Option<&str>) -> String {
        let named = |name: &str, value: Option<&str>| {
            value.map_or_else(String::new, |value| format!("{name}={}&", segment(value)))
        };
        let limit = self.limit.unwrap_or(Self::LIMITS.0);
        named("phase", self.phase.as_deref()) + &named("before", before) + &format!("limit={limit}")
    }

    /// The runs that are asked for, as far as the viewer may know of them.
    pub(crate) async fn list(&self, reader: &Reader, viewer: &Viewer) -> Result<RunList, Trouble> {
        let (phase, before, limit) = (self.phase.as_deref(), self.before.as_deref(), self.limit()?);
        let list = reader.older_runs(viewer, phase, before, limit).await?;
        list.ok_or_else(|| Trouble::Unknown { what: "run", name: before.unwrap_or_default().to_owned() })
    }
}

/// A place in a phase's list, as it stands in an address.
pub(crate) fn ordinal(word: &str) -> Result<u32, Trouble> {
    word.parse().map_err(|_| Trouble::Unknown { what: "episode", name: word.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_are_names_and_nothing_else() {
        assert_eq!(host("arena.example:8080"), Some("arena.example"));
        assert_eq!(host("127.0.0.1"), Some("127.0.0.1"));
        assert_eq!(host("a;reboot"), None);
        assert_eq!(host(":80"), None);
        assert_eq!(host("[::1]:8080"), None);
    }

    #[test]
    fn secrets_come_from_bearer_headers_only() {
        assert_eq!(bearer("Bearer abc"), Some("abc"));
        assert_eq!(bearer("bearer  abc "), Some("abc"));
        assert_eq!(bearer("Basic abc"), None);
        assert_eq!(bearer("abc"), None);
        assert_eq!(bearer(&format!("Bearer {}", "x".repeat(513))), None);
    }
}
