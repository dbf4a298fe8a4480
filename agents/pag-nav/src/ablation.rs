use serde::Serialize;

/// Parts of [`PagNav`](crate::PagNav) that can be taken away, to see what they are worth. Nothing is, by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ablation {
    /// It hears nothing: it searches by frontiers, grounds goals by sight alone, and takes every Submit for right where the
    /// rules tell no outcome.
    pub no_audio: bool,
    /// Rooms and things around a place say nothing of what is there.
    pub no_priors: bool,
    /// Things are forgotten when they leave the picture; one look is all that verification can ask for.
    pub no_memory: bool,
    /// A candidate needs no verification: it is submitted as soon as it is near and faced.
    pub no_gate: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PagNav, Weights};
    use avln_client::{Action, Agent, Audio, GoalCue, Mission, Observation, TaskSpec};

    /// What an agent does that stands still and hears noise in its left ear, or nothing.
    fn acts(mut agent: PagNav, hears: bool) -> Vec<Action> {
        let noise = |sample: u32| (sample.wrapping_mul(2_654_435_761) >> 16) as f32 / 65_536.0 - 0.5;
        let left: Vec<f32> = (0..4000).map(noise).collect();
        let audio = Audio { sample_rate_hz: 16_000, right: vec![0.0; left.len()], left };
        let goals = vec![GoalCue::Category("bed".to_owned()); 2];
        agent.begin(&TaskSpec::default(), &Mission { goals, ..Mission::default() });
        let seen = |step| Observation {
            step,
            remaining_steps: 1000 - step,
            audio: hears.then(|| audio.clone()),
            ..Observation::default()
        };
        (0..20).map(|step| agent.act(&seen(step))).collect()
    }

    #[test]
    fn without_audio_sound_changes_nothing() {
        let deaf = || PagNav::default().without(Ablation { no_audio: true, ..Ablation::default() });
        assert_eq!(acts(deaf(), true), acts(deaf(), false));
        assert_ne!(acts(PagNav::default(), true), acts(PagNav::default(), false));
    }

    #[test]
    fn without_audio_sight_is_worth_what_both_were() {
        let (all, silent) = (Weights::default(), Weights::default().silent());
        let sum = |weights: &Weights| weights.ground_vis + weights.ground_context + weights.ground_audio;
        assert!((sum(&all) - sum(&silent)).abs() < 1e-6 && silent.ground_audio == 0.0);
        assert!(
            (silent.ground_vis / silent.ground_context - all.ground_vis / all.ground_context).abs() < 1e-5
        );
    }
}
