//! Leaderboard selection: query parameters, and the links that change them.

use crate::{
    error::{RequestError, Result},
    format::{rfc3339, url_encode},
    request::RequestContext,
};
use avln_challenge::MethodType;
use avln_episode::Order;
use avln_scoring::{Key, Prominence};
use avln_store::{LeaderboardQuery, LeaderboardView, PhaseView, RowFilter, RunChoice, calendar};
use axum::{
    extract::{FromRequestParts, Query},
    http::request::Parts,
};
use std::{collections::BTreeSet, str::FromStr};

const LAST_SECOND: u32 = 86_399;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Orders {
    One(Order),
    Both,
}

impl Orders {
    pub(crate) fn is_only(self, order: &Order) -> bool {
        self == Self::One(*order)
    }
}

/// Parameter names, ordered as [`LeaderboardParams::sensors`].
pub(crate) const SENSOR_PARAMS: [&str; 3] = ["rgb", "depth", "audio"];
const SENSOR_WORDS: [(&str, bool); 2] = [("with", true), ("without", false)];

/// Leaderboard query parameters. Missing parameters default to the phase's ranking.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct LeaderboardParams {
    pub(crate) orders: Option<Orders>,
    pub(crate) sort: Option<Key>,
    pub(crate) pick: Option<RunChoice>,
    /// Part of a method, version or team; empty for all entries.
    pub(crate) search: String,
    /// Team name; empty for all teams.
    pub(crate) team: String,
    /// Method type; `None` for all.
    pub(crate) method_type: Option<MethodType>,
    /// Filters by colour, depth and sound: true for agents with the sensor.
    pub(crate) sensors: [Option<bool>; 3],
    /// Latest completion time, milliseconds since 1970-01-01 UTC.
    pub(crate) as_of_unix_ms: Option<i64>,
    /// Columns; empty for the default ones.
    pub(crate) columns: Vec<Key>,
    /// True if a parameter was empty, as in forms.
    pub(crate) has_blanks: bool,
}

impl<S: Sync> FromRequestParts<S> for LeaderboardParams {
    type Rejection = RequestError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self> {
        let pairs = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri);
        let Query(pairs) = pairs.map_err(|error| RequestError::Invalid(error.body_text()))?;
        Self::from_pairs(&pairs)
    }
}

impl LeaderboardParams {
    fn from_pairs(pairs: &[(String, String)]) -> Result<Self> {
        let mut params = Self::default();
        for (name, value) in pairs {
            params.set(name, value)?;
        }
        Ok(params)
    }

    fn set(&mut self, name: &str, value: &str) -> Result<()> {
        if value.is_empty() {
            self.has_blanks = true;
        }
        match name {
            "order" if value == "both" => self.orders = Some(Orders::Both),
            "order" => self.orders = parse(name, value)?.map(Orders::One),
            "sort" => self.sort = parse(name, value)?,
            "pick" => {
                self.pick = choice(name, value, [("best", RunChoice::Best), ("latest", RunChoice::Latest)])?
            }
            "q" => value.trim().clone_into(&mut self.search),
            "team" => value.clone_into(&mut self.team),
            "type" => self.method_type = parse(name, value)?,
            "as_of" => self.as_of_unix_ms = parse_day(value)?,
            "column" => self.columns.extend(parse::<Key>(name, value)?),
            other => {
                let sensor = SENSOR_PARAMS.iter().position(|sensor| *sensor == other);
                let sensor =
                    sensor.ok_or_else(|| RequestError::Invalid(format!("unknown parameter '{other}'")))?;
                self.sensors[sensor] = choice(name, value, SENSOR_WORDS)?;
            }
        }
        Ok(())
    }

    pub(crate) fn order(&self, phase: &PhaseView) -> Result<Order> {
        match self.orders {
            Some(Orders::One(order)) => Ok(order),
            Some(Orders::Both) => {
                Err(RequestError::Invalid("this address supports a single order, not both".to_owned()))
            }
            None => Ok(first_order(phase)),
        }
    }

    /// Returns the orders for a page: by default all, side by side.
    pub(crate) fn shown_orders(&self, phase: &PhaseView) -> Orders {
        let usual = if phase.orders.len() > 1 { Orders::Both } else { Orders::One(first_order(phase)) };
        self.orders.unwrap_or(usual)
    }

    fn query<'a>(&self, phase: &'a PhaseView, order: Order, now_unix_ms: i64) -> LeaderboardQuery<'a> {
        LeaderboardQuery {
            phase: &phase.id,
            order,
            key: self.sort.unwrap_or(phase.ranking.key),
            pick: self.pick.unwrap_or(phase.ranking.entry),
            as_of_unix_ms: self.as_of_unix_ms,
            now_unix_ms,
            filter: RowFilter {
                words: self.search.clone(),
                team: self.team.clone(),
                method_type: self.method_type,
                senses: self.sensors,
            },
        }
    }

    pub(crate) async fn read(
        &self,
        context: &RequestContext,
        phase: &PhaseView,
        order: Order,
    ) -> Result<LeaderboardView> {
        let query = self.query(phase, order, context.now_unix_ms);
        let view = context.reader.leaderboard(&context.viewer, &query).await?;
        view.ok_or_else(|| RequestError::unknown("phase", phase.id.clone()))
    }

    pub(crate) async fn read_all(
        &self,
        context: &RequestContext,
        phase: &PhaseView,
    ) -> Result<Vec<LeaderboardView>> {
        let mut views = Vec::new();
        for &order in &phase.orders {
            views.push(self.read(context, phase, order).await?);
        }
        Ok(views)
    }

    /// Rejects a selection of columns, for responses with all columns.
    pub(crate) fn reject_columns(&self) -> Result<()> {
        if self.columns.is_empty() {
            return Ok(());
        }
        let message = "the API returns all columns; remove the parameter 'column'";
        Err(RequestError::Invalid(message.to_owned()))
    }

    pub(crate) fn is_filtered(&self) -> bool {
        let has_names = !self.search.is_empty() || !self.team.is_empty();
        has_names || self.method_type.is_some() || self.sensors.iter().any(Option::is_some)
    }

    /// Returns the table metrics, including the ranking key.
    pub(crate) fn shown_columns(&self, key: Key) -> Vec<Key> {
        let is_shown = |column: &Key| {
            if self.columns.is_empty() { is_default(*column) } else { self.columns.contains(column) }
        };
        Key::ALL.into_iter().filter(|column| *column == key || is_shown(column)).collect()
    }

    /// Returns the canonical query string, without the phase's defaults. Equal selections have equal addresses.
    pub(crate) fn address(&self, phase: &PhaseView) -> String {
        let mut parts = Vec::new();
        let mut add = |name: &str, value: &str| parts.push(format!("{name}={}", url_encode(value)));
        if let Some(Orders::One(order)) = self.orders.filter(|_| phase.orders.len() > 1) {
            add("order", order.as_str());
        }
        if let Some(key) = self.sort.filter(|key| *key != phase.ranking.key) {
            add("sort", key.as_str());
        }
        if let Some(pick) = self.pick.filter(|pick| *pick != phase.ranking.entry) {
            add("pick", pick.as_str());
        }
        for (name, value) in [("q", &self.search), ("team", &self.team)] {
            if !value.is_empty() {
                add(name, value);
            }
        }
        if let Some(method_type) = self.method_type {
            add("type", method_type.as_str());
        }
        for (name, filter) in SENSOR_PARAMS.iter().zip(self.sensors) {
            if let Some(filter) = filter {
                add(name, sensor_word(filter));
            }
        }
        if let Some(moment) = self.as_of_unix_ms {
            add("as_of", &day(moment));
        }
        if Key::ALL.into_iter().any(|key| self.columns.contains(&key) != is_default(key)) {
            for key in Key::ALL.into_iter().filter(|key| self.columns.contains(key)) {
                add("column", key.as_str());
            }
        }
        if parts.is_empty() { String::new() } else { format!("?{}", parts.join("&")) }
    }
}

fn is_default(column: Key) -> bool {
    column.metric().prominence != Prominence::Optional
}

fn sensor_word(is_required: bool) -> &'static str {
    if is_required { "with" } else { "without" }
}

fn first_order(phase: &PhaseView) -> Order {
    phase.orders.first().copied().unwrap_or(Order::Unordered)
}

/// Parses a value; `None` if it is empty.
fn parse<T: FromStr<Err: std::fmt::Display>>(name: &str, value: &str) -> Result<Option<T>> {
    let wrong = |error| RequestError::Invalid(format!("{name}: {error}"));
    if value.is_empty() { Ok(None) } else { value.parse().map(Some).map_err(wrong) }
}

/// Finds the choice for `value`; `None` if it is empty.
fn choice<T: Copy>(name: &str, value: &str, choices: [(&str, T); 2]) -> Result<Option<T>> {
    if value.is_empty() {
        return Ok(None);
    }
    let [first, second] = choices.map(|(word, _)| word);
    let wrong = || RequestError::Invalid(format!("{name} must be {first} or {second}, not '{value}'"));
    let found = choices.into_iter().find(|(word, _)| *word == value);
    found.map(|(_, choice)| Some(choice)).ok_or_else(wrong)
}

/// Returns the last millisecond of a day such as `2026-07-01`.
fn parse_day(value: &str) -> Result<Option<i64>> {
    if value.is_empty() {
        return Ok(None);
    }
    let end = || {
        let mut parts = value.split('-');
        let mut next = || parts.next()?.parse::<u16>().ok();
        let (year, month, day) = (next()?, next()?, next()?);
        parts.next().is_none().then_some(())?;
        calendar::unix_ms(year, u8::try_from(month).ok()?, u8::try_from(day).ok()?, LAST_SECOND)
    };
    let wrong = || RequestError::Invalid(format!("as_of must be a day such as 2026-07-01, not '{value}'"));
    end().map(|end| Some(end + 999)).ok_or_else(wrong)
}

pub(crate) fn day(unix_ms: i64) -> String {
    rfc3339(unix_ms).split('T').next().unwrap_or_default().to_owned()
}

/// Form and links for other selections from the same phase.
pub(crate) struct LeaderboardControls {
    pub(crate) params: LeaderboardParams,
    pub(crate) phase: PhaseView,
    pub(crate) key: Key,
    pub(crate) pick: RunChoice,
    pub(crate) teams: BTreeSet<String>,
}

impl LeaderboardControls {
    pub(crate) fn new(params: &LeaderboardParams, view: &LeaderboardView) -> Self {
        Self {
            params: params.clone(),
            phase: view.phase.clone(),
            key: view.key,
            pick: view.pick,
            teams: view.teams.clone(),
        }
    }

    pub(crate) fn path(&self) -> String {
        format!("/leaderboard/{}", url_encode(&self.phase.id))
    }

    fn changed(&self, change: impl FnOnce(&mut LeaderboardParams)) -> String {
        let mut params = self.params.clone();
        change(&mut params);
        self.path() + &params.address(&self.phase)
    }

    pub(crate) fn sorted_by(&self, key: &Key) -> String {
        self.changed(|params| params.sort = Some(*key))
    }

    pub(crate) fn ordered_by(&self, order: &Order) -> String {
        self.changed(|params| params.orders = Some(Orders::One(*order)))
    }

    pub(crate) fn side_by_side(&self) -> String {
        self.changed(|params| params.orders = Some(Orders::Both))
    }

    pub(crate) fn picked_by(&self, pick: RunChoice) -> String {
        self.changed(|params| params.pick = Some(pick))
    }

    pub(crate) fn unfiltered(&self) -> String {
        self.changed(|params| {
            *params = LeaderboardParams {
                orders: params.orders,
                sort: params.sort,
                pick: params.pick,
                ..LeaderboardParams::default()
            }
        })
    }

    pub(crate) fn api_address(&self, name: &str) -> String {
        let orders = self.params.orders.filter(|orders| *orders != Orders::Both);
        let params = LeaderboardParams { columns: vec![], orders, ..self.params.clone() };
        format!("/api/v1/phases/{}/{name}{}", url_encode(&self.phase.id), params.address(&self.phase))
    }

    pub(crate) fn query_string(&self) -> String {
        self.params.address(&self.phase)
    }

    /// Returns the form's hidden `order`; all orders need none.
    pub(crate) fn order_value(&self) -> Option<&'static str> {
        match self.params.orders {
            Some(Orders::One(order)) => Some(order.as_str()),
            Some(Orders::Both) | None => None,
        }
    }

    pub(crate) fn sensors(&self) -> [(&'static str, &'static str, &'static str); 3] {
        let labels = ["Colour", "Depth", "Sound"];
        let value = |index: usize| self.params.sensors[index].map_or("", sensor_word);
        [0, 1, 2].map(|index| (SENSOR_PARAMS[index], labels[index], value(index)))
    }

    /// Returns the types with their choice in the form.
    pub(crate) fn method_types(&self) -> impl Iterator<Item = (MethodType, bool)> {
        MethodType::ALL.iter().map(|&known| (known, self.params.method_type == Some(known)))
    }

    pub(crate) fn day(&self) -> String {
        self.params.as_of_unix_ms.map_or_else(String::new, day)
    }

    pub(crate) fn columns(&self) -> Vec<(Key, bool)> {
        let shown = self.params.shown_columns(self.key);
        Key::ALL.into_iter().map(|key| (key, shown.contains(&key))).collect()
    }

    /// Returns true if the form has entries; the page then shows it open.
    pub(crate) fn is_open(&self) -> bool {
        self.params.is_filtered() || self.params.as_of_unix_ms.is_some() || !self.params.columns.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn params(query: &str) -> Result<LeaderboardParams> {
        let uri = format!("/x?{query}").parse().expect("an address");
        let Query(pairs) = Query::<Vec<(String, String)>>::try_from_uri(&uri).expect("pairs");
        LeaderboardParams::from_pairs(&pairs)
    }

    #[test]
    fn empty_form_fields_are_ignored() {
        let query = params("order=&sort=&q=&team=&type=&audio=&as_of=&column=spl").expect("a query");
        assert_eq!(
            query,
            LeaderboardParams { columns: vec![Key::Spl], has_blanks: true, ..LeaderboardParams::default() }
        );
        assert!(!query.is_filtered());
        assert_eq!(query.shown_columns(Key::Sr), [Key::Sr, Key::Spl]);
        assert_eq!(LeaderboardParams::default().shown_columns(Key::Sna).len(), 10);
    }

    #[test]
    fn unknown_values_are_rejected() {
        for wrong in [
            "colour=red",
            "order=sideways",
            "sort=fame",
            "pick=worst",
            "type=magic",
            "audio=yes",
            "as_of=2026-02-30",
            "as_of=now",
        ] {
            params(wrong).expect_err(wrong);
        }
    }

    #[test]
    fn days_end_with_their_last_millisecond() {
        let query = params("as_of=1970-01-02").expect("a day");
        assert_eq!(query.as_of_unix_ms, Some(2 * 86_400_000 - 1));
        assert_eq!(day(2 * 86_400_000 - 1), "1970-01-02");
    }
}
