use avln_client::{Action, Agent, GoalCue, Mission, Observation, TaskSpec};

/// Hashes everything that an agent is told, senses and does.
pub(super) struct DigestingAgent {
    agent: Box<dyn Agent + Send>,
    /// Actions after which it stops.
    most_steps: u32,
    /// A hash of each episode so far.
    episodes: Vec<blake3::Hasher>,
}

impl DigestingAgent {
    pub(super) fn new(agent: Box<dyn Agent + Send>, most_steps: u32) -> Self {
        Self { agent, most_steps, episodes: Vec::new() }
    }

    /// The digests of the episodes, hexadecimal.
    pub(super) fn digests(&self) -> Vec<String> {
        self.episodes.iter().map(|hasher| hasher.finalize().to_hex().to_string()).collect()
    }
}

impl Agent for DigestingAgent {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let mut hasher = blake3::Hasher::new();
        for goal in &mission.goals {
            match goal {
                GoalCue::Category(text) | GoalCue::Description(text) => hasher.update(text.as_bytes()),
                GoalCue::Image(image) => hasher.update(&image.pixels),
            };
            hasher.update(b"\n");
        }
        self.episodes.push(hasher);
        self.agent.begin(task, mission);
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let action = match self.agent.act(observation) {
            _ if observation.step + 1 >= self.most_steps => Action::Stop,
            action => action,
        };
        if let Some(hasher) = self.episodes.last_mut() {
            observe(hasher, observation);
            hasher.update(format!("{action:?}\n").as_bytes());
        }
        action
    }
}

fn observe(hasher: &mut blake3::Hasher, seen: &Observation) {
    let pose = seen.pose.position.into_iter().chain([seen.pose.heading_rad]);
    floats(hasher, pose);
    if let Some(image) = &seen.rgb {
        hasher.update(&image.pixels);
    }
    if let Some(depth) = &seen.depth {
        floats(hasher, depth.metres.iter().copied());
    }
    if let Some(audio) = &seen.audio {
        floats(hasher, audio.left.iter().chain(&audio.right).copied());
    }
}

fn floats(hasher: &mut blake3::Hasher, values: impl Iterator<Item = f32>) {
    let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
    hasher.update(&bytes);
}
