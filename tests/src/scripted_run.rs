//! A run with fixed actions.

use crate::PHASE;
use avln_client::{Action, Client, Observation, Order, RunOptions, Sensors};

/// Pose only.
pub const NO_SENSORS: Sensors =
    Sensors { rgb: false, depth: false, audio: false, width: 64, height: 64, hfov_rad: 1.57 };
/// Most actions per episode.
pub const STEPS: u32 = 41;

/// Pose and sound.
pub const AUDIO_ONLY: Sensors = Sensors { audio: true, ..NO_SENSORS };

/// Plays a run's episodes in sequence; returns the id.
pub async fn play_script(url: &str, token: &str, method: &str) -> String {
    play_script_with(url, token, method, NO_SENSORS, |_, _| ()).await
}

/// Plays with `sensors` and passes each observation to `sense`, with the episode index from 0.
pub async fn play_script_with(
    url: &str,
    token: &str,
    method: &str,
    sensors: Sensors,
    mut sense: impl FnMut(u32, &Observation),
) -> String {
    let client = Client::connect(url, token).await.expect("a connection");
    let run = client.start_run(RunOptions::new(PHASE, method).order(Order::Unordered)).await.expect("a run");
    let mut play = client.play(&run, sensors).await.expect("a stream");
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
