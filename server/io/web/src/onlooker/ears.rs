use super::{Listening, MaybeDesk, parts};
use crate::{
    trouble::Trouble,
    visit::{self, Asked, Nothing, Visit},
};
use avln_store::EpisodeView;
use axum::{Extension, extract::Path, http::HeaderMap, response::Response};

/// Most steps in one file: half a minute, 3.8 MB. A file is in memory as long as somebody takes it, and is to be taken before the
/// door asks its visitors to connect anew.
pub(crate) const WINDOW_STEPS: u32 = 120;

/// The first and the last step of the file that has `step` in it, in an episode whose last step is `last`.
pub(crate) fn window_of(step: u32, last: u32) -> [u32; 2] {
    let first = step - step % WINDOW_STEPS;
    [first, last.min(first + WINDOW_STEPS - 1)]
}

/// The episode that a view is of, where its viewer may hear it.
pub(super) fn listening(view: &EpisodeView) -> Option<Listening> {
    view.replay.as_ref().filter(|replay| replay.hears)?;
    Some(Listening { phase: view.run.phase.clone(), run: view.run.run.clone(), ordinal: view.ordinal })
}

/// What both ears heard in some steps.
pub(crate) async fn sound(
    visit: Visit,
    Path((run, place, file)): Path<(String, String, String)>,
    Extension(desk): Extension<MaybeDesk>,
    headers: HeaderMap,
    _: Asked<Nothing>,
) -> Result<Response, Trouble> {
    let view = visit.reader.episode(&visit.viewer, &run, visit::ordinal(&place)?).await?;
    let none = || Trouble::Unknown { what: "sound", name: format!("{file} of episode {place} of run {run}") };
    let (desk, view) = (desk.ok_or_else(none)?, view.ok_or_else(none)?);
    let [first, last] = steps(&file).ok_or_else(none)?;
    let listening = listening(&view).ok_or_else(none)?;
    if last.saturating_sub(first) >= WINDOW_STEPS {
        return Err(Trouble::Invalid(format!(
            "steps {first} to {last} of episode {} are more than the {WINDOW_STEPS} that one file holds; ask for a part of them",
            listening.ordinal
        )));
    }
    let sound = desk.sound(&view).await?.ok_or_else(none)?;
    let wav = sound.wav(first as usize, last as usize).ok_or_else(none)?;
    Ok(parts::answer("audio/wav", wav, &headers))
}

/// The steps of a file called `FIRST-LAST.wav`.
fn steps(file: &str) -> Option<[u32; 2]> {
    let (first, last) = file.strip_suffix(".wav")?.split_once('-')?;
    Some([first.parse().ok()?, last.parse().ok()?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_named_by_their_steps() {
        assert_eq!(steps("0-119.wav"), Some([0, 119]));
        for wrong in ["0-119", "0.wav", "-1-5.wav", "a-b.wav", "0-4294967296.wav", "..-..wav"] {
            assert_eq!(steps(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn every_step_is_in_the_file_of_its_window() {
        assert_eq!(
            [0, 119, 120, 250].map(|step| window_of(step, 250)),
            [[0, 119], [0, 119], [120, 239], [240, 250]]
        );
        assert_eq!(window_of(0, 0), [0, 0]);
    }
}
