use super::segment;
use crate::board::{BoardQuery, Orders, SENSES, Sense, day};
use avln_episode::Order;
use avln_scoring::Key;
use avln_store::{LeaderboardView, PhaseView, RunChoice};
use std::collections::BTreeSet;

/// What a visitor can choose on a board: links and a form that lead to the same phase, seen otherwise.
pub(super) struct Choice {
    pub(super) query: BoardQuery,
    phase: PhaseView,
    pub(super) key: Key,
    pub(super) pick: RunChoice,
    /// The teams with entries.
    pub(super) teams: BTreeSet<String>,
}

impl Choice {
    /// The choice on a board that has all its entries yet.
    pub(super) fn new(query: &BoardQuery, view: &LeaderboardView) -> Self {
        Self {
            query: query.clone(),
            phase: view.phase.clone(),
            key: view.key,
            pick: view.pick,
            teams: view.teams.clone(),
        }
    }

    pub(super) fn path(&self) -> String {
        format!("/leaderboard/{}", segment(&self.phase.id))
    }

    fn changed(&self, change: impl FnOnce(&mut BoardQuery)) -> String {
        let mut query = self.query.clone();
        change(&mut query);
        self.path() + &query.address(&self.phase)
    }

    pub(super) fn sorted_by(&self, key: &Key) -> String {
        self.changed(|query| query.sort = Some(*key))
    }

    pub(super) fn ordered_by(&self, order: &Order) -> String {
        self.changed(|query| query.orders = Some(Orders::One(*order)))
    }

    /// Both orders side by side.
    pub(super) fn side_by_side(&self) -> String {
        self.changed(|query| query.orders = Some(Orders::Both))
    }

    pub(super) fn picked_by(&self, pick: RunChoice) -> String {
        self.changed(|query| query.pick = Some(pick))
    }

    /// All entries, now.
    pub(super) fn unfiltered(&self) -> String {
        self.changed(|query| {
            *query = BoardQuery {
                orders: query.orders,
                sort: query.sort,
                pick: query.pick,
                ..BoardQuery::default()
            }
        })
    }

    /// The same for programs, whose tables have all columns.
    pub(super) fn twin(&self, name: &str) -> String {
        let orders = self.query.orders.filter(|orders| *orders != Orders::Both);
        let query = BoardQuery { columns: vec![], orders, ..self.query.clone() };
        format!("/api/v1/phases/{}/{name}{}", segment(&self.phase.id), query.address(&self.phase))
    }

    /// Orders that can be chosen.
    pub(super) fn orders(&self) -> &[Order] {
        &self.phase.orders
    }

    /// The word of the order that is shown, for the form; all of them need none.
    pub(super) fn order_word(&self) -> Option<&'static str> {
        match self.query.orders {
            Some(Orders::One(order)) => Some(order.as_str()),
            Some(Orders::Both) | None => None,
        }
    }

    /// Each sense: its name in addresses, its name for people, and what is chosen.
    pub(super) fn senses(&self) -> [(&'static str, &'static str, &'static str); 3] {
        let names = ["Colours", "Depth", "Sound"];
        [0, 1, 2]
            .map(|index| (SENSES[index], names[index], self.query.senses[index].map_or("", Sense::as_str)))
    }

    /// Whether this team's entries are wanted.
    pub(super) fn is_team(&self, team: &str) -> bool {
        self.query.team == team
    }

    /// The day that is chosen.
    pub(super) fn day(&self) -> String {
        self.query.as_of_unix_ms.map_or_else(String::new, day)
    }

    /// Each metric and whether it is shown.
    pub(super) fn columns(&self) -> Vec<(Key, bool)> {
        let shown = self.query.shown_columns(self.key);
        Key::ALL.into_iter().map(|key| (key, shown.contains(&key))).collect()
    }

    /// Whether something is chosen that the form tells.
    pub(super) fn is_open(&self) -> bool {
        self.query.is_filtered() || self.query.as_of_unix_ms.is_some() || !self.query.columns.is_empty()
    }
}
