//! Which targets and cues a mission gets: what was used less comes first.

use super::MissionOptions;
use crate::{
    cue::CueSpec,
    reference::{Atlas, Departure},
    survey::Instance,
};
use avln_episode::Modality;
use avln_geom::Rng;

/// How far chance may move an instance in the order of use, uses.
const CHANCE_USES: f64 = 2.0;
/// How much more an instance's own use of a modality counts than that of the whole scene.
const OWN_WEIGHT: f64 = 4.0;
/// How far chance may move a choice of modalities.
const CHANCE_MODALITY: f64 = 3.0;
/// The modalities in the order in which they are counted.
const MODALITIES: [Modality; 3] = [Modality::Category, Modality::Description, Modality::Image];

/// Instances that may be targets, with what has been asked of them so far.
pub(super) struct Pool<'a> {
    pub(super) instances: Vec<&'a Instance>,
    uses: Vec<u32>,
    /// How often each instance was asked for in each modality.
    asked: Vec<[u32; 3]>,
}

impl<'a> Pool<'a> {
    pub(super) fn new(instances: Vec<&'a Instance>) -> Self {
        let count = instances.len();
        Self { instances, uses: vec![0; count], asked: vec![[0; 3]; count] }
    }

    /// Notes that a mission asks for `chosen` in `modalities`.
    pub(super) fn note(&mut self, chosen: &[usize], modalities: &[Modality]) {
        for (&index, modality) in chosen.iter().zip(modalities) {
            self.uses[index] += 1;
            self.asked[index][place(*modality)] += 1;
        }
    }

    /// Picks `count` targets one after the other: a new category, far enough from the start and from those picked.
    pub(super) fn targets(
        &self,
        atlas: &Atlas,
        start: &Departure,
        options: &MissionOptions,
        count: usize,
        rng: &mut Rng,
    ) -> Option<Vec<usize>> {
        let uses = self.uses.iter().map(|&uses| f64::from(uses) + CHANCE_USES * rng.unit());
        let mut candidates: Vec<(f64, usize)> = uses.zip(0..).collect();
        candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let category = |index: usize| self.instances[index].target.category.as_str();
        let mut chosen: Vec<usize> = Vec::with_capacity(count);
        for (_, index) in candidates {
            let new_category = chosen.iter().all(|&other| category(other) != category(index));
            let apart = |&other: &usize| within(atlas.apart_m(other, index), options.min_separation_m);
            if new_category
                && chosen.iter().all(apart)
                && within(atlas.start_m(start, index), options.min_start_m)
            {
                chosen.push(index);
            }
            if chosen.len() == count {
                rng.shuffle(&mut chosen);
                return Some(chosen);
            }
        }
        None
    }

    /// Gives each target a modality: at least two different ones, the less used ones first.
    pub(super) fn modalities(&self, chosen: &[usize], rng: &mut Rng) -> Option<Vec<Modality>> {
        let totals =
            self.asked.iter().fold([0_u32; 3], |sum, asked| std::array::from_fn(|m| sum[m] + asked[m]));
        let least = totals.iter().copied().min().unwrap_or(0);
        let mut best: Option<(f64, Vec<Modality>)> = None;
        for choice in choices(chosen.iter().map(|&index| available(self.instances[index])).collect()) {
            if choice.iter().all(|modality| *modality == choice[0]) {
                continue;
            }
            let weight = |(&index, &modality): (&usize, &Modality)| {
                let own = self.asked[index][place(modality)];
                f64::from(totals[place(modality)] - least) + OWN_WEIGHT * f64::from(own)
            };
            let cost = chosen.iter().zip(&choice).map(weight).sum::<f64>() + CHANCE_MODALITY * rng.unit();
            if best.as_ref().is_none_or(|best| cost < best.0) {
                best = Some((cost, choice));
            }
        }
        best.map(|best| best.1)
    }

    /// The cue of `modality` for an instance: one of its sentences or pictures.
    pub(super) fn cue(&self, index: usize, modality: Modality, rng: &mut Rng) -> Option<CueSpec> {
        let instance = self.instances[index];
        match modality {
            Modality::Category => Some(CueSpec::Category),
            Modality::Description => rng.choose(&instance.sentences).cloned().map(CueSpec::Description),
            Modality::Image => rng.choose(&instance.images).copied().map(CueSpec::Image),
        }
    }
}

/// Whether there is a way, and it is long enough.
fn within(distance_m: f64, least_m: f64) -> bool {
    distance_m.is_finite() && distance_m >= least_m
}

fn place(modality: Modality) -> usize {
    match modality {
        Modality::Category => 0,
        Modality::Description => 1,
        Modality::Image => 2,
    }
}

fn available(instance: &Instance) -> Vec<Modality> {
    let can = |modality: &Modality| match modality {
        Modality::Category => true,
        Modality::Description => !instance.sentences.is_empty(),
        Modality::Image => !instance.images.is_empty(),
    };
    MODALITIES.into_iter().filter(can).collect()
}

/// All ways to take one of each list.
fn choices(lists: Vec<Vec<Modality>>) -> Vec<Vec<Modality>> {
    lists.into_iter().fold(vec![Vec::new()], |begun, list| {
        let longer = |begin: &Vec<Modality>| {
            let begin = begin.clone();
            list.iter().map(move |&modality| [begin.as_slice(), &[modality]].concat()).collect::<Vec<_>>()
        };
        begun.iter().flat_map(longer).collect()
    })
}
