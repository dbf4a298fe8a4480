//! A random agent: `cargo run -p avln-client --example random -- TOKEN [http://127.0.0.1:50051] [PHASE]`.

use avln_client::{
    Action, Agent, Client, Error, Mission, Observation, RunOptions, Sensors, TaskSpec, evaluate,
};

/// Moves forward, turns now and then, stops with the last step.
struct Random {
    state: u64,
}

impl Random {
    /// A xorshift number below `bound`.
    fn below(&mut self, bound: u64) -> u64 {
        self.state ^= self.state << 13;
        self.state ^= self.state >> 7;
        self.state ^= self.state << 17;
        self.state % bound
    }
}

impl Agent for Random {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        println!("{} steps, {} goals: {:?}", task.max_steps, mission.order, mission.goals);
    }

    fn act(&mut self, observation: &Observation) -> Action {
        if observation.remaining_steps == 1 {
            return Action::Stop;
        }
        match self.below(100) {
            0 if observation.remaining_submits > 0 => Action::Submit,
            0..15 => Action::TurnLeft,
            15..30 => Action::TurnRight,
            _ => Action::MoveForward,
        }
    }
}

#[tokio::main]
async fn main() -> Result<(), Error> {
    let mut arguments = std::env::args().skip(1);
    let token = arguments.next().unwrap_or_default();
    let server = arguments.next().unwrap_or_else(|| "http://127.0.0.1:50051".to_owned());
    let phase = arguments.next().unwrap_or_default();

    let client = Client::connect(server, token).await?;
    let run = client.start_run(RunOptions::new(phase, "example-random")).await?;
    let summary = evaluate(&client, &run, Sensors::square(128), &mut Random { state: 42 }).await?;
    println!("{summary}");
    Ok(())
}
