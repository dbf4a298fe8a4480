//! A run that is played by heart.

use crate::PHASE;
use avln_client::{Action, Client, Observation, Order, RunOptions, Sensors};

/// No senses but its pose.
pub const BLIND: Sensors =
    Sensors { rgb: false, depth: false, audio: false, width: 64, height: 64, hfov_rad: 1.57 };
/// Actions of each episode, unless it ends by itself.
pub const STEPS: u32 = 41;

/// Ears, and nothing else.
pub const EARS: Sensors = Sensors { audio: true, ..BLIND };

/// Plays all episodes of a run over `url`, one after the other; gives back its id.
pub async fn stroll(url: &str, token: &str, method: &str) -> String {
    stroll_with(url, token, method, BLIND, |_, _| ()).await
}

/// The same with `sensors`; `sense` is told the episode, counted from 0, and each observation.
pub async fn stroll_with(
    url: &str,
    token: &str,
    method: &str,
    sensors: Sensors,
    mut sense: impl FnMut(u32, &Observation),
) -> String {
    let arena = Client::connect(url, token).await.expect("the door is open");
    let run = arena.start_run(RunOptions::new(PHASE, method).order(Order::Unordered)).await.expect("a run");
    let mut play = arena.play(&run, sensors).await.expect("a stream");
    while let Some(mut episode) = play.next_episode().await.expect("a stream") {
        let ordinal = episode.ordinal() - 1;
        sense(ordinal, episode.observation());
        while !episode.is_over() {
            let action = match episode.observation().step + 1 {
                STEPS => Action::Stop,
                20 => Action::Submit,
                step if step % 7 == 3 => Action::TurnLeft,
                _ => Action::MoveForward,
            };
            episode.step(action).await.expect("a legal step");
            sense(ordinal, episode.observation());
        }
    }
    assert!(play.finish().await.expect("a summary").complete);
    run.id
}
