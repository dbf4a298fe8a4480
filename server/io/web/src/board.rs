//! Which board somebody asks for, as it stands in addresses.

use crate::{
    trouble::Trouble,
    words::{self, rfc3339},
};
use avln_episode::Order;
use avln_scoring::Key;
use avln_store::{LeaderboardQuery, PhaseView, RowFilter, RunChoice, calendar};
use axum::{
    extract::{FromRequestParts, Query},
    http::request::Parts,
};
use std::{fmt::Write as _, str::FromStr};

/// Metrics of a table when nobody chose any.
const USUAL_COLUMNS: [Key; 9] = [
    Key::Sr,
    Key::Isr,
    Key::Osr,
    Key::Spl,
    Key::SoftSpl,
    Key::Steps,
    Key::PathM,
    Key::Collisions,
    Key::WrongSubmits,
];
/// The last second of a day, from its beginning.
const LAST_SECOND: u32 = 86_399;

/// Which boards of a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Orders {
    One(Order),
    /// All that the phase allows, side by side.
    Both,
}

impl Orders {
    /// Whether these are `order` alone.
    pub(crate) fn are(self, order: &Order) -> bool {
        self == Self::One(*order)
    }
}

/// Whether entries with a sense are wanted, or those without.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sense {
    With,
    Without,
}

/// Names of the senses in addresses, in the order of [`BoardQuery::senses`].
pub(crate) const SENSES: [&str; 3] = ["rgb", "depth", "audio"];

/// Which board is asked for; what was not said is as the organiser ranks.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct BoardQuery {
    pub(crate) orders: Option<Orders>,
    pub(crate) sort: Option<Key>,
    pub(crate) pick: Option<RunChoice>,
    /// What method, version or team hold; empty: anything.
    pub(crate) words: String,
    /// Whose entries; empty: everybody's.
    pub(crate) team: String,
    /// Colours, depth and sound.
    pub(crate) senses: [Option<Sense>; 3],
    /// Entries that were there at the end of this day, milliseconds since 1970-01-01 UTC.
    pub(crate) as_of_unix_ms: Option<i64>,
    /// Metrics of the table; empty: the usual ones.
    pub(crate) columns: Vec<Key>,
    /// Whether something was said and left empty, as forms do.
    pub(crate) has_blanks: bool,
}

impl<S: Sync> FromRequestParts<S> for BoardQuery {
    type Rejection = Trouble;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Trouble> {
        let pairs = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri);
        let Query(pairs) = pairs.map_err(|error| Trouble::Invalid(error.body_text()))?;
        pairs.iter().try_fold(Self::default(), |query, (name, value)| query.said(name, value))
    }
}

impl BoardQuery {
    /// The same with one more thing said.
    fn said(mut self, name: &str, value: &str) -> Result<Self, Trouble> {
        if value.is_empty() {
            self.has_blanks = true;
        }
        match name {
            "order" if value == "both" => self.orders = Some(Orders::Both),
            "order" => self.orders = read(name, value)?.map(Orders::One),
            "sort" => self.sort = read(name, value)?,
            "pick" => self.pick = read_pick(value)?,
            "q" => value.trim().clone_into(&mut self.words),
            "team" => value.clone_into(&mut self.team),
            "as_of" => self.as_of_unix_ms = read_day(value)?,
            "column" => self.columns.extend(read::<Key>(name, value)?),
            other => {
                let sense = SENSES.iter().position(|sense| *sense == other);
                let sense =
                    sense.ok_or_else(|| Trouble::Invalid(format!("'{other}' cannot be asked for")))?;
                self.senses[sense] = read_sense(value)?;
            }
        }
        Ok(self)
    }

    /// The order of goals when one board is wanted.
    pub(crate) fn order(&self, phase: &PhaseView) -> Result<Order, Trouble> {
        match self.orders {
            Some(Orders::One(order)) => Ok(order),
            Some(Orders::Both) => Err(Trouble::Invalid("one order is shown here, not both".to_owned())),
            None => Ok(usual_order(phase)),
        }
    }

    /// What a page shows: all orders of goals side by side when nothing was said.
    pub(crate) fn shown_orders(&self, phase: &PhaseView) -> Orders {
        let usual = if phase.orders.len() > 1 { Orders::Both } else { Orders::One(usual_order(phase)) };
        self.orders.unwrap_or(usual)
    }

    /// The board of a phase for goals in one order.
    pub(crate) fn board<'a>(
        &self,
        phase: &'a PhaseView,
        order: Order,
        now_unix_ms: i64,
    ) -> LeaderboardQuery<'a> {
        LeaderboardQuery {
            phase: &phase.id,
            order,
            key: self.sort.unwrap_or(phase.ranking.key),
            pick: self.pick.unwrap_or(phase.ranking.entry),
            as_of_unix_ms: self.as_of_unix_ms,
            now_unix_ms,
            filter: RowFilter {
                words: self.words.clone(),
                team: self.team.clone(),
                senses: self.senses.map(|sense| sense.map(|sense| sense == Sense::With)),
            },
        }
    }

    /// Whether only some entries are wanted.
    pub(crate) fn is_filtered(&self) -> bool {
        !self.words.is_empty() || !self.team.is_empty() || self.senses.iter().any(Option::is_some)
    }

    /// The metrics of the table; what it is ordered by is always among them.
    pub(crate) fn shown_columns(&self, key: Key) -> Vec<Key> {
        let usual = self.columns.is_empty();
        let wanted = |column: &Key| {
            *column == key
                || if usual { USUAL_COLUMNS.contains(column) } else { self.columns.contains(column) }
        };
        Key::ALL.into_iter().filter(wanted).collect()
    }

    /// What stands behind `?`, in one order and without what is usual in `phase`, so that equal boards have equal addresses. All
    /// orders of goals side by side are usual.
    pub(crate) fn address(&self, phase: &PhaseView) -> String {
        let mut parts = Vec::new();
        let mut add = |name: &str, value: &str| parts.push(format!("{name}={}", encoded(value)));
        if let Some(Orders::One(order)) = self.orders.filter(|_| phase.orders.len() > 1) {
            add("order", order.as_str());
        }
        self.sort.filter(|key| *key != phase.ranking.key).iter().for_each(|key| add("sort", key.as_str()));
        self.pick
            .filter(|pick| *pick != phase.ranking.entry)
            .iter()
            .for_each(|p| add("pick", words::pick(p)));
        for (name, value) in [("q", &self.words), ("team", &self.team)] {
            if !value.is_empty() {
                add(name, value);
            }
        }
        for (name, sense) in SENSES.iter().zip(self.senses) {
            sense.iter().for_each(|sense| add(name, sense.as_str()));
        }
        self.as_of_unix_ms.iter().for_each(|moment| add("as_of", &day(*moment)));
        let columns = Key::ALL.into_iter().filter(|key| self.columns.contains(key)).collect::<Vec<_>>();
        if columns != USUAL_COLUMNS {
            columns.iter().for_each(|key| add("column", key.as_str()));
        }
        if parts.is_empty() { String::new() } else { format!("?{}", parts.join("&")) }
    }
}

impl Sense {
    pub(crate) fn as_str(self) -> &'static str {
        match self {
            Self::With => "with",
            Self::Without => "without",
        }
    }
}

/// The order of goals that a phase shows first.
fn usual_order(phase: &PhaseView) -> Order {
    phase.orders.first().copied().unwrap_or(Order::Unordered)
}

/// A word of a closed list; `None` when it was left empty.
fn read<T: FromStr<Err: std::fmt::Display>>(name: &str, value: &str) -> Result<Option<T>, Trouble> {
    let wrong = |error| Trouble::Invalid(format!("{name}: {error}"));
    if value.is_empty() { Ok(None) } else { value.parse().map(Some).map_err(wrong) }
}

fn read_pick(value: &str) -> Result<Option<RunChoice>, Trouble> {
    match value {
        "" => Ok(None),
        "best" => Ok(Some(RunChoice::Best)),
        "latest" => Ok(Some(RunChoice::Latest)),
        other => Err(Trouble::Invalid(format!("pick is best or latest, not '{other}'"))),
    }
}

fn read_sense(value: &str) -> Result<Option<Sense>, Trouble> {
    match value {
        "" => Ok(None),
        "with" => Ok(Some(Sense::With)),
        "without" => Ok(Some(Sense::Without)),
        other => Err(Trouble::Invalid(format!("a sense is with or without, not '{other}'"))),
    }
}

/// The end of a day that is written `2026-07-01`.
fn read_day(value: &str) -> Result<Option<i64>, Trouble> {
    if value.is_empty() {
        return Ok(None);
    }
    let parts: Vec<&str> = value.split('-').collect();
    let end = match parts[..] {
        [year, month, day] => year
            .parse()
            .ok()
            .zip(month.parse().ok())
            .zip(day.parse().ok())
            .and_then(|((year, month), day)| calendar::unix_ms(year, month, day, LAST_SECOND)),
        _ => None,
    };
    let wrong = || Trouble::Invalid(format!("as_of is a day such as 2026-07-01, not '{value}'"));
    end.map(|end| Some(end + 999)).ok_or_else(wrong)
}

/// The UTC day of a moment.
pub(crate) fn day(unix_ms: i64) -> String {
    rfc3339(unix_ms).split('T').next().unwrap_or_default().to_owned()
}

/// A value as it stands in a query.
fn encoded(text: &str) -> String {
    let mut out = String::new();
    for &byte in text.as_bytes() {
        if byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.' | b'~') {
            out.push(char::from(byte));
        } else {
            let _ = write!(out, "%{byte:02X}");
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(query: &str) -> Result<BoardQuery, Trouble> {
        let uri = format!("/x?{query}").parse().expect("an address");
        let Query(pairs) = Query::<Vec<(String, String)>>::try_from_uri(&uri).expect("pairs");
        pairs.iter().try_fold(BoardQuery::default(), |query, (name, value)| query.said(name, value))
    }

    #[test]
    fn forms_leave_things_empty_and_that_says_nothing() {
        let query = asked("order=&sort=&q=&team=&audio=&as_of=&column=spl").expect("a query");
        assert_eq!(query, BoardQuery { columns: vec![Key::Spl], has_blanks: true, ..BoardQuery::default() });
        assert!(!query.is_filtered());
        assert_eq!(query.shown_columns(Key::Sr), [Key::Sr, Key::Spl]);
        assert_eq!(BoardQuery::default().shown_columns(Key::Sna).len(), 10);
    }

    #[test]
    fn what_cannot_be_asked_for_is_refused() {
        for wrong in [
            "colour=red",
            "order=sideways",
            "sort=fame",
            "pick=worst",
            "audio=yes",
            "as_of=2026-02-30",
            "as_of=now",
        ] {
            asked(wrong).expect_err(wrong);
        }
    }

    #[test]
    fn a_day_ends_with_its_last_millisecond() {
        let query = asked("as_of=1970-01-02").expect("a day");
        assert_eq!(query.as_of_unix_ms, Some(2 * 86_400_000 - 1));
        assert_eq!(day(2 * 86_400_000 - 1), "1970-01-02");
    }

    #[test]
    fn values_are_encoded_for_addresses() {
        assert_eq!(encoded("a b&c=é"), "a%20b%26c%3D%C3%A9");
    }
}
