//! An episode stream: `cargo run -p avln-client --example episodes -- TOKEN [http://127.0.0.1:50051] [PHASE]`.

use avln_client::{Action, Client, Episode, Error, RunOptions, Sensors};
use tokio_stream::StreamExt;

const LAST_STEP: u32 = 40;

/// Walks in a square and stops.
async fn play(mut episode: Episode<'static>) -> Result<(), Error> {
    while !episode.is_over() {
        let action = match episode.observation().step {
            LAST_STEP.. => Action::Stop,
            step if step % 10 < 7 => Action::MoveForward,
            _ => Action::TurnRight,
        };
        episode.step(action).await?;
    }
    if let Some(end) = episode.end() {
        println!("{}: {} after {} steps", episode.ordinal(), end.reason, end.steps);
    }
    Ok(())
}

#[tokio::main]
async fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let token = arguments.next().unwrap_or_default();
    let server = arguments.next().unwrap_or_else(|| "http://127.0.0.1:50051".to_owned());
    let phase = arguments.next().unwrap_or_default();

    let client = Client::connect(server, token).await?;
    let run = client.start_run(RunOptions::new(phase, "example-episodes")).await?;
    let mut episodes = client.play(&run, Sensors::square(128)).await?.episodes();
    while let Some(episode) = episodes.try_next().await? {
        play(episode).await?;
    }
    println!("{}", episodes.finish().await?);
    Ok(())
}
