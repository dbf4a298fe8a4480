//! Request data: viewer, page context, and typed query parameters.

use crate::{
    error::{RequestError, Result},
    format::url_encode,
};
use avln_store::{
    CompareView, EpisodeView, Incomparable, MissionsView, PhaseView, Reader, RunList, RunView, Viewer,
};
use axum::{
    extract::{FromRequestParts, Path, Query},
    http::{Uri, header, request::Parts},
};
use serde::{Deserialize, de::DeserializeOwned};
use std::{
    convert::Infallible,
    fmt,
    sync::Arc,
    time::{SystemTime, UNIX_EPOCH},
};

pub(crate) struct RequestContext {
    pub(crate) reader: Reader,
    pub(crate) viewer: Viewer,
    /// Request time, milliseconds since 1970-01-01 UTC.
    pub(crate) now_unix_ms: i64,
}

impl FromRequestParts<Reader> for RequestContext {
    type Rejection = RequestError;

    async fn from_request_parts(parts: &mut Parts, reader: &Reader) -> Result<Self> {
        let now_unix_ms = now_unix_ms();
        let viewer = match parts.headers.get(header::AUTHORIZATION) {
            // Set by the session middleware.
            None => parts.extensions.get::<Viewer>().cloned().unwrap_or(Viewer::Anonymous),
            Some(value) => {
                let secret = value.to_str().ok().and_then(bearer).ok_or(RequestError::BadToken)?;
                reader.viewer(secret, now_unix_ms).await?.ok_or(RequestError::BadToken)?
            }
        };
        Ok(Self { reader: reader.clone(), viewer, now_unix_ms })
    }
}

impl RequestContext {
    pub(crate) async fn phase(&self, id: &str) -> Result<PhaseView> {
        let phase = self.reader.phase(&self.viewer, id, self.now_unix_ms).await?;
        phase.ok_or_else(|| RequestError::unknown("phase", id))
    }

    pub(crate) async fn missions(&self, phase: &str) -> Result<MissionsView> {
        let missions = self.reader.missions(&self.viewer, phase).await?;
        missions.ok_or_else(|| RequestError::unknown("public list of missions of phase", phase))
    }

    pub(crate) async fn run(&self, id: &str) -> Result<RunView> {
        let run = self.reader.run(&self.viewer, id).await?;
        run.ok_or_else(|| RequestError::unknown("run", id))
    }

    pub(crate) async fn episode(&self, run: &str, ordinal: &str) -> Result<EpisodeView> {
        let unknown = || RequestError::unknown("episode", format!("{ordinal} of run {run}"));
        let index = ordinal.parse().map_err(|_| unknown())?;
        self.reader.episode(&self.viewer, run, index).await?.ok_or_else(unknown)
    }
}

/// Returns the secret from an `Authorization: Bearer` header.
fn bearer(value: &str) -> Option<&str> {
    let (scheme, secret) = value.split_once(' ')?;
    (scheme.eq_ignore_ascii_case("bearer") && secret.len() <= 512).then(|| secret.trim())
}

pub(crate) fn now_unix_ms() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}

tokio::task_local! {
    // A task-local, because every page needs it and handlers have nothing else to do with it.
    pub(crate) static CONTEXT: PageContext;
}

/// Parts of the page frame that depend on the visitor and the running arena.
#[derive(Clone, Debug, Default)]
pub(crate) struct PageContext {
    pub(crate) menu: Menu,
    /// The organiser's announcement; may be empty.
    pub(crate) announcement: String,
    /// Time of a static copy, milliseconds since 1970-01-01 UTC; `None` on a server.
    pub(crate) frozen_unix_ms: Option<i64>,
}

impl PageContext {
    pub(crate) fn current() -> Self {
        CONTEXT.try_with(Self::clone).unwrap_or_default()
    }

    /// Returns true for a static copy, which offers nothing to play.
    pub(crate) fn is_frozen(&self) -> bool {
        self.frozen_unix_ms.is_some()
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Menu {
    /// No entry: this server has no sign-in.
    #[default]
    Plain,
    Stranger,
    Team,
    Organiser,
}

impl Menu {
    pub(crate) fn link(self) -> Option<(&'static str, &'static str)> {
        match self {
            Self::Plain => None,
            Self::Stranger => Some(("/sign-in", "Sign in")),
            Self::Team => Some(("/me", "My page")),
            Self::Organiser => Some(("/organise", "Organise")),
        }
    }
}

/// Configured address of the gRPC server.
#[derive(Clone, Default)]
pub(crate) struct GrpcEndpoint {
    port: u16,
    is_secure: bool,
    canonical: Option<Arc<str>>,
}

impl GrpcEndpoint {
    /// Combines the port and TLS of this server with its canonical addresses, if any.
    pub(crate) fn new(port: u16, is_secure: bool, grpc_url: Option<&str>, web_url: Option<&str>) -> Self {
        let mut endpoint = Self { port, is_secure, canonical: None };
        let web_host = web_url.and_then(|url| url.parse::<Uri>().ok()?.host().map(str::to_owned));
        let at_web_host = web_host.map(|host| endpoint.at(&host));
        endpoint.canonical = grpc_url.map(str::to_owned).or(at_web_host).map(Arc::from);
        endpoint
    }

    /// Returns true if no page needs the `Host` header.
    pub(crate) fn is_canonical(&self) -> bool {
        self.canonical.is_some()
    }

    fn at(&self, host: &str) -> String {
        let scheme = if self.is_secure { "https" } else { "http" };
        format!("{scheme}://{host}:{}", self.port)
    }
}

/// The gRPC server's address for commands on a page: the canonical one or, without any, the request's host name with the gRPC
/// port.
pub(crate) struct GrpcAddress(String);

impl fmt::Display for GrpcAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl<S: Sync> FromRequestParts<S> for GrpcAddress {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        let endpoint = parts.extensions.get::<GrpcEndpoint>().cloned().unwrap_or_default();
        if let Some(canonical) = endpoint.canonical {
            return Ok(Self(canonical.to_string()));
        }
        let value = parts.headers.get(header::HOST).and_then(|value| value.to_str().ok());
        Ok(Self(endpoint.at(value.and_then(host_name).unwrap_or("127.0.0.1"))))
    }
}

/// Returns the origin of a URL as browsers write it; `None` for other texts.
pub(crate) fn origin(url: &str) -> Option<String> {
    let uri: Uri = url.parse().ok()?;
    let (scheme, host) = (uri.scheme_str()?, uri.host()?.to_ascii_lowercase());
    let port = match (scheme, uri.port_u16()) {
        ("http", Some(80)) | ("https", Some(443)) | (_, None) => String::new(),
        (_, Some(port)) => format!(":{port}"),
    };
    Some(format!("{scheme}://{host}{port}"))
}

/// Returns the host name from a `Host` header. Visitors copy it into a shell, so unusual characters are rejected.
fn host_name(value: &str) -> Option<&str> {
    let name = value.rsplit_once(':').map_or(value, |(name, _)| name);
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '.' | '-');
    (!name.is_empty() && name.len() <= 253 && name.chars().all(is_plain)).then_some(name)
}

/// Typed query parameters; unknown parameters are rejected.
pub(crate) struct StrictQuery<T>(pub(crate) T);

impl<T: DeserializeOwned, S: Sync> FromRequestParts<S> for StrictQuery<T> {
    type Rejection = RequestError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self> {
        match Query::<T>::try_from_uri(&parts.uri) {
            Ok(Query(parameters)) => Ok(Self(parameters)),
            Err(error) => Err(RequestError::Invalid(error.body_text())),
        }
    }
}

/// Path parameters of an address without query.
pub(crate) struct PathOnly<T>(pub(crate) T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for PathOnly<T> {
    type Rejection = RequestError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self> {
        StrictQuery::<NoParameters>::from_request_parts(parts, state).await?;
        let path = Path::from_request_parts(parts, state).await;
        path.map(|Path(path)| Self(path)).map_err(|error| RequestError::of_status(error.status()))
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct NoParameters {}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CompareQuery {
    pub(crate) first: String,
    pub(crate) second: String,
}

impl CompareQuery {
    pub(crate) async fn view(&self, context: &RequestContext) -> Result<CompareView> {
        let Self { first, second } = self;
        let reason = match context.reader.compare(&context.viewer, [first, second]).await? {
            Some(Ok(view)) => return Ok(view),
            Some(Err(Incomparable::Apart)) => "they belong to different phases or orders of goals",
            Some(Err(Incomparable::Hidden)) => "their phase hides the scores of single episodes",
            None => return Err(RequestError::unknown("pair of runs", format!("{first} and {second}"))),
        };
        let message = format!("the runs '{first}' and '{second}' cannot be compared: {reason}");
        Err(RequestError::Invalid(message))
    }
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct DocsQuery {
    /// Words to search for; empty for all documents.
    pub(crate) q: String,
}

impl DocsQuery {
    const MAX_WORDS: usize = 32;

    /// Returns the words in lower case.
    pub(crate) fn words(&self) -> Result<Vec<String>> {
        let words: Vec<String> = self.q.split_whitespace().map(str::to_lowercase).collect();
        if words.len() > Self::MAX_WORDS {
            let message = format!("q has {} words, but must have at most {}", words.len(), Self::MAX_WORDS);
            return Err(RequestError::Invalid(message));
        }
        Ok(words)
    }
}

#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReplayQuery {
    /// Step; by default the last one.
    pub(crate) t: Option<u32>,
    /// Front storey, counted from 1; by default the agent's.
    pub(crate) storey: Option<usize>,
    ears: Option<Ears>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Ears {
    On,
}

impl ReplayQuery {
    /// Returns true if the page shows sound levels, which requires rendering.
    pub(crate) fn shows_levels(self) -> bool {
        self.ears == Some(Ears::On)
    }
}

#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PictureQuery {
    pub(crate) sensor: Option<PictureSensor>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PictureSensor {
    Rgb,
    Depth,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RunsQuery {
    pub(crate) phase: Option<String>,
    pub(crate) before: Option<String>,
    pub(crate) limit: Option<u32>,
}

impl RunsQuery {
    pub(crate) const LIMITS: (u32, u32) = (50, 200);

    pub(crate) fn limit(&self) -> Result<u32> {
        let (usual, most) = Self::LIMITS;
        match self.limit.unwrap_or(usual) {
            limit if (1..=most).contains(&limit) => Ok(limit),
            limit => Err(RequestError::Invalid(format!("limit is {limit}, but must be 1 to {most}"))),
        }
    }

    /// Returns the query string for the page after `before`, or for the first page.
    pub(crate) fn address(&self, before: Option<&str>) -> String {
        let parameter = |name: &str, value: Option<&str>| {
            value.map_or_else(String::new, |value| format!("{name}={}&", url_encode(value)))
        };
        let limit = self.limit.unwrap_or(Self::LIMITS.0);
        parameter("phase", self.phase.as_deref()) + &parameter("before", before) + &format!("limit={limit}")
    }

    pub(crate) async fn list(&self, reader: &Reader, viewer: &Viewer) -> Result<RunList> {
        let before = self.before.as_deref();
        let list = reader.older_runs(viewer, self.phase.as_deref(), before, self.limit()?).await?;
        list.ok_or_else(|| RequestError::unknown("run", before.unwrap_or_default()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn host_names_are_safe_in_a_shell() {
        assert_eq!(host_name("arena.example:8080"), Some("arena.example"));
        assert_eq!(host_name("127.0.0.1"), Some("127.0.0.1"));
        assert_eq!(host_name("a;reboot"), None);
        assert_eq!(host_name(":80"), None);
        assert_eq!(host_name("[::1]:8080"), None);
    }

    #[test]
    fn grpc_address_prefers_its_own_url() {
        let address = |grpc, web| GrpcEndpoint::new(50051, false, grpc, web).canonical;
        let (grpc, web) = (Some("https://arena.example"), Some("https://www.arena.example:8443"));
        assert_eq!(address(grpc, web).as_deref(), grpc);
        assert_eq!(address(None, web).as_deref(), Some("http://www.arena.example:50051"));
        assert_eq!(address(None, Some("http://[::1]:80")).as_deref(), Some("http://[::1]:50051"));
        assert!(address(None, None).is_none() && !GrpcEndpoint::new(1, true, None, None).is_canonical());
    }

    #[test]
    fn origins_omit_default_ports_and_paths() {
        for (url, expected) in [
            ("https://Arena.example", "https://arena.example"),
            ("https://arena.example:443/board", "https://arena.example"),
            ("http://127.0.0.1:8080", "http://127.0.0.1:8080"),
            ("https://arena.example:80", "https://arena.example:80"),
        ] {
            assert_eq!(origin(url).as_deref(), Some(expected));
        }
        assert_eq!(origin("arena.example"), None);
    }

    #[test]
    fn only_bearer_headers_hold_a_secret() {
        assert_eq!(bearer("Bearer abc"), Some("abc"));
        assert_eq!(bearer("bearer  abc "), Some("abc"));
        assert_eq!(bearer("Basic abc"), None);
        assert_eq!(bearer("abc"), None);
        assert_eq!(bearer(&format!("Bearer {}", "x".repeat(513))), None);
    }
}
