//! What the missions of a phase are like, where everybody may see their replays.

use super::segment;
use crate::{
    replay::plan,
    trouble::Trouble,
    visit::{Asked, Nothing, Visit},
    words,
};
use avln_episode::Modality;
use avln_store::MissionsView;
use axum::{
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};
use std::collections::BTreeMap;

/// Width of the bins of reference tours, metres, and how many there are; the last holds all that are longer.
const BIN_M: f64 = 10.0;
const BINS: usize = 6;

/// How often each thing occurs.
pub(super) struct Statistic {
    pub(super) heading: &'static str,
    /// What is counted.
    pub(super) what: &'static str,
    pub(super) rows: Vec<(String, u32)>,
}

/// Everything of it, as tables with bars, without what there is nothing of.
pub(super) fn statistics(missions: &MissionsView) -> Vec<Statistic> {
    let table = |heading, what, rows| Statistic { heading, what, rows };
    let mut all = vec![
        table(
            "Goals of a mission",
            "Missions",
            counted(&missions.goals, |goals| words::plural(goals, "goal")),
        ),
        table("How goals are told", "Goals", modalities(missions)),
        table("Length of the reference tour", "Missions", lengths(&missions.reference_m)),
        table("Categories", "Goals told by category", counted(&missions.categories, Clone::clone)),
    ];
    all.retain(|statistic| !statistic.rows.is_empty());
    all
}

impl Statistic {
    /// The largest count.
    pub(super) fn most(&self) -> u32 {
        self.rows.iter().map(|(_, count)| *count).max().unwrap_or(0)
    }
}

fn counted<K>(counts: &BTreeMap<K, u32>, name: impl Fn(&K) -> String) -> Vec<(String, u32)> {
    counts.iter().map(|(key, count)| (name(key), *count)).collect()
}

fn modalities(missions: &MissionsView) -> Vec<(String, u32)> {
    let all = [Modality::Category, Modality::Description, Modality::Image];
    let count = |modality: &Modality| missions.modalities.get(modality.as_str()).copied();
    all.iter().filter_map(|modality| Some((words::modality(modality).to_owned(), count(modality)?))).collect()
}

fn lengths(reference_m: &[f64]) -> Vec<(String, u32)> {
    if reference_m.is_empty() {
        return vec![];
    }
    let mut bins = [0; BINS];
    reference_m.iter().for_each(|length| bins[((length / BIN_M) as usize).min(BINS - 1)] += 1);
    let name = |bin: usize| match (bin as f64 * BIN_M, bin + 1 == BINS) {
        (from, true) => format!("{from} m and more"),
        (from, false) => format!("{from} to {} m", from + BIN_M),
    };
    bins.into_iter().enumerate().map(|(bin, count)| (name(bin), count)).collect()
}

/// The scenes with where their plans are.
pub(super) fn scenes(phase: &str, missions: &MissionsView) -> Vec<(String, u32, String)> {
    let address = |index| format!("/phases/{}/scenes/{index}.svg", segment(phase));
    let named = missions.scenes.iter().enumerate();
    named.map(|(index, (name, count))| (name.clone(), *count, address(index))).collect()
}

/// A scene of a phase from above, by its place in the list.
pub(super) async fn scene(
    visit: Visit,
    Path((phase, file)): Path<(String, String)>,
    _: Asked<Nothing>,
) -> Result<Response, Trouble> {
    let unknown = || Trouble::Unknown { what: "picture", name: file.clone() };
    let missions = visit.reader.missions(&visit.viewer, &phase).await?.ok_or_else(unknown)?;
    let index: Option<usize> = file.strip_suffix(".svg").and_then(|index| index.parse().ok());
    let name = index.and_then(|index| missions.scenes.into_keys().nth(index)).ok_or_else(unknown)?;
    let map = visit.reader.scene_map(&visit.viewer, &phase, &name).await?.unwrap_or_default();
    Ok(([(header::CONTENT_TYPE, "image/svg+xml")], plan(&map)).into_response())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tours_are_counted_by_their_length() {
        let told = lengths(&[0.0, 9.9, 10.0, 55.0, 400.0]);
        assert_eq!(told.first().cloned(), Some(("0 to 10 m".to_owned(), 2)));
        assert_eq!(told.last().cloned(), Some(("50 m and more".to_owned(), 2)));
        assert_eq!(told.iter().map(|(_, count)| count).sum::<u32>(), 5);
        assert!(lengths(&[]).is_empty());
    }

    #[test]
    fn there_are_no_tables_of_nothing() {
        assert!(statistics(&MissionsView::default()).is_empty());
        let goals = BTreeMap::from([(2, 3), (4, 1)]);
        let told = statistics(&MissionsView { goals, ..MissionsView::default() });
        assert_eq!((told.len(), told[0].most(), told[0].rows[1].0.as_str()), (1, 3, "4 goals"));
    }
}
