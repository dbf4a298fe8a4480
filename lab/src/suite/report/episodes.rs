//! Every episode that the tables rest on.

use crate::suite::Line;
use std::fmt::Write as _;

/// Names of the columns.
const HEADER: &str = "agent,order,episode,scene,goals,found,sr,isr,osr,spl,soft_spl,steps,path_m,reference_m,collisions,\
                      wrong_submits,steps_to_first_goal,end\n";

/// A row for each episode, in the order of the lines. Names of agents, episodes and houses hold nothing to quote.
pub(super) fn table(lines: &[&Line]) -> String {
    let mut text = HEADER.to_owned();
    for Line { key, scene, metrics: m, end, .. } in lines {
        let first = m.steps_to_goal.iter().flatten().min().map(u32::to_string).unwrap_or_default();
        let _ = writeln!(
            text,
            "{},{},{},{scene},{},{},{},{:.4},{:.4},{:.4},{:.4},{},{:.2},{:.2},{},{},{first},{}",
            key.agent,
            key.order,
            key.episode,
            m.goals,
            m.found,
            m.sr,
            m.isr,
            m.osr,
            m.spl,
            m.soft_spl,
            m.steps,
            m.path_m,
            m.reference_m,
            m.collisions,
            m.wrong_submits,
            end.as_str()
        );
    }
    text
}
