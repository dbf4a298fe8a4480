//! Four parallel slots: `cargo run -p avln-client --example slots -- TOKEN [http://127.0.0.1:50051] [PHASE]`.

use avln_client::{Action, Client, Error, Play, RunOptions, Sensors};
use tokio::task::JoinSet;

const SLOTS: u32 = 4;

/// Turns around once per episode, and stops.
async fn turn_around(mut play: Play) -> Result<Play, Error> {
    let turns = (std::f32::consts::TAU / play.task().turn_rad).round() as u32;
    while let Some(mut episode) = play.next_episode().await? {
        while !episode.is_over() {
            let is_around = episode.observation().step >= turns;
            episode.step(if is_around { Action::Stop } else { Action::TurnLeft }).await?;
        }
    }
    Ok(play)
}

#[tokio::main]
async fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let token = arguments.next().unwrap_or_default();
    let server = arguments.next().unwrap_or_else(|| "http://127.0.0.1:50051".to_owned());
    let phase = arguments.next().unwrap_or_default();

    let client = Client::connect(server, token).await?;
    let run = client.start_run(RunOptions::new(phase, "example-slots")).await?;
    let mut slots = JoinSet::new();
    for play in client.play_slots(&run, Sensors::square(128), SLOTS).await? {
        slots.spawn(turn_around(play));
    }
    let mut last = None;
    while let Some(joined) = slots.join_next().await {
        match joined {
            Ok(played) => last = Some(played?),
            Err(error) => eprintln!("a slot failed: {error}"),
        }
    }
    if let Some(play) = last {
        println!("{}", play.finish().await?);
    }
    Ok(())
}
