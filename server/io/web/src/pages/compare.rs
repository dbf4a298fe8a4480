use super::{Page, Part, Shell, segment, write};
use crate::{
    visit::{Asked, CompareQuery, Visit},
    words,
};
use askama::Template;
use avln_store::{CompareView, PairView, RunLine};

#[derive(Template)]
#[template(path = "compare.html")]
struct ComparePage {
    shell: Shell,
    view: CompareView,
    /// Episodes by who found all goals: both, only the first, only the second, neither.
    groups: [Group; 4],
}

/// Episodes that ended alike.
struct Group {
    /// Its place on the page.
    anchor: &'static str,
    words: &'static str,
    pairs: Vec<PairView>,
}

/// Two runs side by side.
pub(super) async fn page(visit: Visit, Asked(query): Asked<CompareQuery>) -> Page {
    let view = query.view(&visit).await?;
    let title = format!("{} and {}", name(&view.first), name(&view.second));
    let shell = Shell::new(title, Part::Boards)
        .below("Leaderboards", "/leaderboard")
        .below(view.first.phase.clone(), board(&view.first));
    let groups = groups(&view.episodes);
    write(&ComparePage { shell, view, groups })
}

impl ComparePage {
    /// The same for programs, in a file that ends so.
    fn twin(&self, end: &str) -> String {
        let [first, second] = [&self.view.first, &self.view.second].map(|line| segment(&line.run));
        format!("/api/v1/compare{end}?first={first}&second={second}")
    }
}

fn name(line: &RunLine) -> String {
    format!("{} {}", line.method, line.version)
}

fn board(line: &RunLine) -> String {
    format!("/leaderboard/{}?order={}", segment(&line.phase), line.order)
}

fn groups(pairs: &[PairView]) -> [Group; 4] {
    let all_found = |pair: &PairView| [pair.first.sr, pair.second.sr].map(|sr| sr > 0.5);
    let group = |anchor, words, outcome: [bool; 2]| {
        let pairs = pairs.iter().filter(|pair| all_found(pair) == outcome).cloned().collect();
        Group { anchor, words, pairs }
    };
    [
        group("both", "Both found all goals", [true, true]),
        group("first", "Only the first found all goals", [true, false]),
        group("second", "Only the second found all goals", [false, true]),
        group("neither", "Neither found all goals", [false, false]),
    ]
}
