//! Presets, switches and ablations.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

/// A named set of weights and switches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// The formulas as printed in the paper.
    #[default]
    PagNav,
    /// The paper's agent with extensions (source positions, counted windows, stairs, outcomes by silence) and other weights.
    PagNavPlus,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 2] = [Self::PagNav, Self::PagNavPlus];

    /// Returns the name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::PagNav => "pag-nav",
            Self::PagNavPlus => "pag-nav-plus",
        }
    }

    /// Returns the name of the method on leaderboards.
    pub fn method(self) -> &'static str {
        match self {
            Self::PagNav => "PAG-Nav",
            Self::PagNavPlus => "PAG-Nav+",
        }
    }

    /// Returns the file with weights, units and ranges.
    pub(crate) fn file(self) -> &'static str {
        match self {
            Self::PagNav => include_str!("../presets/pag-nav.toml"),
            Self::PagNavPlus => include_str!("../presets/pag-nav-plus.toml"),
        }
    }
}

/// Extensions of the paper, each on or off. None bypasses the Submit gate; the first lowers its visual floor at located sources.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Switches {
    /// Estimates the positions of sound sources from bearings and levels. s_aud becomes the nearness of the frontier to the chosen
    /// source, if the certainty is at least `vague`; s_int that of the candidate to a source, times certainty, loudness and
    /// agreement. A located source at a candidate lowers the floor of s_vis from
    /// `verify_unheard` to `verify_floor`. A near source extends the search on the storey, distant ones shorten it.
    pub source_positions: bool,
    /// Counts sounding windows to separate the sources.
    pub count_windows: bool,
    /// Walks straight to an estimated source; needs source_positions.
    pub direct_approach: bool,
    /// Pairs sources and goals jointly in ordered missions, and in all missions with distractor sources; needs source_positions and
    /// count_windows.
    pub joint_association: bool,
    /// Searches other storeys by known stairs.
    pub stairs: bool,
    /// Waits at the gate for the target's sound, and infers the outcome from silence, unless found targets complete their turn; needs
    /// count_windows.
    pub silence_outcomes: bool,
}

/// A switch in [`Switches`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// [`Switches::source_positions`].
    SourcePositions,
    /// [`Switches::count_windows`].
    CountWindows,
    /// [`Switches::direct_approach`].
    DirectApproach,
    /// [`Switches::joint_association`].
    JointAssociation,
    /// [`Switches::stairs`].
    Stairs,
    /// [`Switches::silence_outcomes`].
    SilenceOutcomes,
}

impl Switches {
    /// Disables a switch and the switches that need it.
    #[must_use]
    pub fn without(self, switch: Switch) -> Self {
        let mut left = self;
        match switch {
            Switch::SourcePositions => left.source_positions = false,
            Switch::CountWindows => left.count_windows = false,
            Switch::DirectApproach => left.direct_approach = false,
            Switch::JointAssociation => left.joint_association = false,
            Switch::Stairs => left.stairs = false,
            Switch::SilenceOutcomes => left.silence_outcomes = false,
        }
        left.direct_approach &= left.source_positions;
        left.joint_association &= left.source_positions && left.count_windows;
        left.silence_outcomes &= left.count_windows;
        left
    }

    /// Returns a switch with a disabled dependency, and the dependency.
    pub(crate) fn missing(&self) -> Option<(&'static str, &'static str)> {
        let positions = ("source_positions", self.source_positions);
        let windows = ("count_windows", self.count_windows);
        let needs = [
            ("direct_approach", self.direct_approach, positions),
            ("joint_association", self.joint_association, positions),
            ("joint_association", self.joint_association, windows),
            ("silence_outcomes", self.silence_outcomes, windows),
        ];
        let missing = needs.into_iter().find(|(_, is_on, (_, has_needed))| *is_on && !has_needed);
        missing.map(|(switch, _, (needed, _))| (switch, needed))
    }

    /// Disables the switches that an ablation excludes.
    pub(crate) fn under(self, ablation: Ablation) -> Self {
        let mut left = self;
        if ablation.has_no_search_by_sound() {
            left = left.without(Switch::SourcePositions);
        }
        if ablation.no_audio {
            left = left.without(Switch::CountWindows);
        }
        if ablation.no_outcomes { left.without(Switch::SilenceOutcomes) } else { left }
    }
}

/// Disabled parts of [`PagNav`](crate::PagNav), to measure their value. By default all parts are enabled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ablation {
    /// No hearing at all.
    pub no_audio: bool,
    /// Outcomes by sound, but no sound in search and grounding.
    pub no_search_sound: bool,
    /// Sound in search and grounding, but no outcomes by sound.
    pub no_outcomes: bool,
    /// No object memory: objects out of view are forgotten, and one look verifies. Room types, and the goals seen at located sources,
    /// are kept.
    pub no_object_memory: bool,
    /// One look verifies, as without object memory.
    pub no_second_look: bool,
    /// No acoustic memory: only the current sound, or the current window if windows are counted. Earlier sounds are forgotten, with
    /// the estimates of sources; while an outcome is open, all. Outcomes, views and effort at sources are kept.
    pub no_acoustic_memory: bool,
    /// No accumulated map: only the free floor and obstacles of the current view.
    pub no_map: bool,
    /// Neutral priors from rooms and neighbouring objects.
    pub no_priors: bool,
    /// No visual verification: the agent submits at a plausible candidate at a proper pose. The only variant without the visual
    /// floor.
    pub no_gate: bool,
}

impl Ablation {
    pub(crate) fn has_no_search_by_sound(self) -> bool {
        self.no_audio || self.no_search_sound
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_differ_in_their_switches() {
        let [printed, plus] = Preset::ALL.map(|preset| preset.weights().switches);
        assert_eq!(printed, Switches::default());
        let all = Switches {
            source_positions: true,
            count_windows: true,
            direct_approach: true,
            joint_association: true,
            stairs: true,
            silence_outcomes: true,
        };
        assert_eq!((plus, plus.missing()), (all, None));
        let names = Preset::ALL.map(|preset| preset.to_possible_value().unwrap().get_name().to_owned());
        assert_eq!(names, Preset::ALL.map(Preset::name));
    }

    #[test]
    fn disabled_switches_disable_their_dependents() {
        let all = Preset::PagNavPlus.weights().switches;
        let without = all.without(Switch::SourcePositions);
        assert!(!without.direct_approach && !without.joint_association && without.silence_outcomes);
        let without = all.without(Switch::CountWindows);
        assert!(!without.joint_association && !without.silence_outcomes && without.direct_approach);
        for switch in
            [Switch::DirectApproach, Switch::Stairs, Switch::SilenceOutcomes, Switch::JointAssociation]
        {
            assert!(all.without(switch) != all && all.without(switch).missing().is_none());
        }
    }

    #[test]
    fn ablations_disable_their_switches() {
        let all = Preset::PagNavPlus.weights().switches;
        let none = Ablation::default();
        let deaf = all.under(Ablation { no_audio: true, ..none });
        assert_eq!(deaf, Switches { stairs: true, ..Switches::default() });
        let outcomes = all.under(Ablation { no_search_sound: true, ..none });
        assert!(outcomes.silence_outcomes && !outcomes.source_positions);
        let search = all.under(Ablation { no_outcomes: true, ..none });
        assert!(!search.silence_outcomes && search.joint_association);
    }
}
