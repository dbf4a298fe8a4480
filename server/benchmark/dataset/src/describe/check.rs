//! Check of sentences, independent of their generation: from claims to matching objects.
//!
//! Every claim has two readings. The plain reading must be true for the target. The generous reading, with wide thresholds and
//! every benefit of the doubt, must fail for all rivals.

use crate::{
    cue::{Claim, Claims, Landmark, Name, Relation},
    describe::{
        lexicon::{self, may_be_called, room_noun},
        relate::{Facts, SIDES},
    },
};
use avln_geom::{Aabb, Point3};
use avln_scene::Object;

/// Reading of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reading {
    /// The speaker's: strict.
    Plain,
    /// The searcher's: anything that might fit.
    Generous,
}

impl Reading {
    fn pick<T>(self, plain: T, generous: T) -> T {
        if self == Self::Plain { plain } else { generous }
    }
}

/// Indices of other objects that might fit the sentence.
pub(crate) fn rivals(facts: &Facts, claims: &Claims, target: usize) -> Vec<usize> {
    let named = called(facts, &claims.head, target).into_iter();
    let fits = |index: &usize| {
        claims.list.iter().all(|claim| holds(facts, claim, target, *index, Reading::Generous))
    };
    named.filter(fits).collect()
}

/// Indices of other objects that might fit the noun.
pub(crate) fn called(facts: &Facts, name: &Name, target: usize) -> Vec<usize> {
    let objects = facts.scene.objects.iter().enumerate();
    let named = objects.filter(|(index, object)| *index != target && may_be_called(object, name));
    named.map(|(index, _)| index).collect()
}

/// True if the claims plainly hold for `target` and fit no other object.
pub(crate) fn fits_only(facts: &Facts, claims: &Claims, target: usize) -> bool {
    // Strict for the target, generous for rivals: doubtful cases are rejected on both sides.
    may_be_called(&facts.scene.objects[target], &claims.head)
        && claims.list.iter().all(|claim| holds(facts, claim, target, target, Reading::Plain))
        && rivals(facts, claims, target).is_empty()
}

/// True if a claim about `target` is true for `index`.
pub(crate) fn holds(facts: &Facts, claim: &Claim, target: usize, index: usize, reading: Reading) -> bool {
    let object = &facts.scene.objects[index];
    let words = &object.attributes;
    let said_or_unknown =
        |own: &str, word: &str| own == word || (reading == Reading::Generous && own.is_empty());
    match claim {
        Claim::Color(word) => has_color(facts, object, word, reading),
        Claim::Material(word) => said_or_unknown(&words.material, word),
        Claim::Shape(word) => said_or_unknown(&words.shape, word),
        Claim::Size(word) => has_size(&facts.scene.objects[target], object, word, reading),
        Claim::Room(noun) => is_in(facts, object, noun, reading),
        Claim::Place(relation, landmarks) => is_placed(facts, object, *relation, landmarks, reading),
    }
}

fn has_color(facts: &Facts, object: &Object, word: &str, reading: Reading) -> bool {
    /// Least pixel share for a possible colour word.
    const SOME: f32 = 0.2;
    let label = object.attributes.color.as_str();
    match (facts.palette(object), reading) {
        (Some(palette), Reading::Plain) => {
            palette.mean_word() == Some(word) && (label.is_empty() || label == word)
        }
        (Some(palette), Reading::Generous) => {
            label == word || palette.mean_word() == Some(word) || palette.share_of(word) >= SOME
        }
        (None, _) => label == word || label.is_empty() && reading == Reading::Generous,
    }
}

/// True by label or, read generously, for any object not clearly on the other side of the target.
fn has_size(target: &Object, object: &Object, word: &str, reading: Reading) -> bool {
    const CLEAR: f32 = 1.25;
    if reading == Reading::Plain || object.attributes.size == word {
        return object.attributes.size == word;
    }
    match (Facts::measure(target, word), Facts::measure(object, word)) {
        (Some((own_m, direction)), Some((other_m, _))) if direction > 0.0 => other_m * CLEAR > own_m,
        (Some((own_m, _)), Some((other_m, _))) => other_m < own_m * CLEAR,
        _ => true,
    }
}

fn is_in(facts: &Facts, object: &Object, noun: &str, reading: Reading) -> bool {
    let region = object.region.and_then(|region| facts.scene.regions.get(usize::from(region)));
    match region.and_then(|region| room_noun(&region.label)) {
        Some(own) => own == noun,
        None => reading == Reading::Generous,
    }
}

fn is_placed(
    facts: &Facts,
    own: &Object,
    relation: Relation,
    landmarks: &[Landmark],
    reading: Reading,
) -> bool {
    let fitting = |landmark: &Landmark| -> Vec<&Object> {
        let is_it = |thing: &&Object| {
            thing.id != own.id
                && may_be_called(thing, &landmark.name)
                && landmark.color.as_ref().is_none_or(|color| has_color(facts, thing, color, reading))
        };
        facts.scene.objects.iter().filter(is_it).collect()
    };
    match (relation, landmarks) {
        (Relation::Corner, _) => walls(facts, own, reading).chunks(2).all(|pair| pair.contains(&true)),
        (Relation::AgainstWall, _) => walls(facts, own, reading).contains(&true),
        (Relation::Between, [a, b]) => {
            let (first, second) = (fitting(a), fitting(b));
            let pairs = first.iter().flat_map(|a| second.iter().map(move |b| (a, b)));
            pairs
                .filter(|(a, b)| a.id != b.id)
                .any(|(a, b)| lies_between(&own.bounds, &a.bounds, &b.bounds, reading))
        }
        (_, [landmark]) => {
            fitting(landmark).into_iter().any(|thing| stands_to(facts, own, thing, relation, reading))
        }
        _ => false,
    }
}

fn stands_to(facts: &Facts, own: &Object, thing: &Object, relation: Relation, reading: Reading) -> bool {
    let (a, b) = (&own.bounds, &thing.bounds);
    match relation {
        Relation::NextTo => distance_m(a, b) <= reading.pick(0.4, 0.75),
        Relation::Near => distance_m(a, b) <= reading.pick(1.05, 1.6),
        Relation::On => carries(b, a, reading),
        Relation::Holds => carries(a, b, reading),
        Relation::Under => is_below_top(a, b, reading),
        Relation::Above => is_higher(a, b, reading),
        Relation::Below => is_higher(b, a, reading),
        Relation::LeftOf | Relation::RightOf => is_beside(facts, own, thing, relation, reading),
        Relation::Opposite => is_across(facts, own, thing, reading),
        Relation::Between | Relation::Corner | Relation::AgainstWall => false,
    }
}

/// Returns the distance of two boxes: that of the centre of `b` to `a`, grown by half the size of `b`.
fn distance_m(a: &Aabb, b: &Aabb) -> f32 {
    let half = b.size() * 0.5;
    Aabb::new(a.min - half, a.max + half).distance_m(&b.center())
}

/// True if the centre of `b` is above or below the floor plan of `a`, with `slack_m` tolerance.
fn within_plan(a: &Aabb, b: &Aabb, slack_m: f32) -> bool {
    let middle = b.center();
    let inside = |axis: usize| (a.min[axis] - slack_m..=a.max[axis] + slack_m).contains(&middle[axis]);
    inside(0) && inside(2)
}

/// True if the lower box carries the upper box, on the top or seat.
fn carries(lower: &Aabb, upper: &Aabb, reading: Reading) -> bool {
    /// Objects sink into a thick rug.
    const SINKS_IN_M: f32 = 0.03;
    let seat_y = lower.min.y + reading.pick(0.2, 0.1) * lower.size().y - SINKS_IN_M;
    within_plan(lower, upper, reading.pick(0.02, 0.25))
        && upper.min.y >= seat_y
        && upper.min.y <= lower.max.y + reading.pick(0.08, 0.2)
}

/// True if the inner box is inside the outer floor plan, below the top.
fn is_below_top(inner: &Aabb, outer: &Aabb, reading: Reading) -> bool {
    within_plan(outer, inner, reading.pick(0.02, 0.4))
        && inner.min.y <= outer.min.y + reading.pick(0.15, 0.5)
        && inner.max.y <= outer.max.y + reading.pick(0.0, 0.1)
}

fn is_higher(upper: &Aabb, lower: &Aabb, reading: Reading) -> bool {
    within_plan(lower, upper, reading.pick(0.2, 0.6))
        && upper.min.y >= lower.max.y - reading.pick(0.0, 0.15)
        && upper.min.y <= lower.max.y + reading.pick(1.3, 2.0)
}

fn lies_between(own: &Aabb, a: &Aabb, b: &Aabb, reading: Reading) -> bool {
    let flat = |other: &Aabb| {
        let offset = other.center() - own.center();
        (offset.x, offset.z, (offset.x * offset.x + offset.z * offset.z).sqrt())
    };
    let ((ax, az, a_m), (bx, bz, b_m)) = (flat(a), flat(b));
    let cos = if a_m * b_m > 0.0 { (ax * bx + az * bz) / (a_m * b_m) } else { -1.0 };
    let reach_m = reading.pick(1.1, 1.8);
    cos <= reading.pick(-0.85, -0.5) && distance_m(own, a) <= reach_m && distance_m(own, b) <= reach_m
}

/// Sides with the building surface behind them: east, west, south, north.
fn walls(facts: &Facts, object: &Object, reading: Reading) -> [bool; 4] {
    let (center, half) = (object.bounds.center(), object.bounds.size() / 2.0);
    let reach_m = reading.pick(0.15, 0.5);
    SIDES.map(|[x, z]| {
        let depth_m = if x == 0.0 { half.z } else { half.x };
        let behind = |share: f32| {
            let from = Point3::new(
                center.x + half.x * share * z.abs(),
                center.y,
                center.z + half.z * share * x.abs(),
            );
            facts.wall_m(from, [x, z], depth_m + reach_m).is_some()
        };
        let hits = [-0.75, -0.25, 0.25, 0.75].into_iter().filter(|&share| behind(share)).count();
        hits >= reading.pick(2, 1)
    })
}

/// Left or right for a viewer facing a common wall; read generously, any wall of the first object.
fn is_beside(facts: &Facts, own: &Object, thing: &Object, relation: Relation, reading: Reading) -> bool {
    if distance_m(&own.bounds, &thing.bounds) > reading.pick(1.3, 2.0) {
        return false;
    }
    let (at, with) = (walls(facts, own, reading), walls(facts, thing, reading));
    let offset = own.bounds.center() - thing.bounds.center();
    let faced = |side: usize| at[side] && (with[side] || reading == Reading::Generous);
    (0..4).filter(|&side| faced(side)).any(|side| {
        let [x, z] = SIDES[side];
        let to_the_right_m = offset.z * x - offset.x * z;
        let asked_m = if relation == Relation::RightOf { to_the_right_m } else { -to_the_right_m };
        asked_m > reading.pick(0.0, -0.2)
    })
}

/// True if floor separates both and neither touches the other's wall.
fn is_across(facts: &Facts, own: &Object, thing: &Object, reading: Reading) -> bool {
    let (a, b) = (&own.bounds, &thing.bounds);
    let gap_m = distance_m(a, b);
    let (lowest_m, highest_m) = (reading.pick(1.1, 0.7), reading.pick(5.0, 7.0));
    let apart = (lowest_m..=highest_m).contains(&gap_m);
    let shared = |axis: usize| a.max[axis].min(b.max[axis]) - a.min[axis].max(b.min[axis]);
    let aligned = shared(0).max(shared(2)) > reading.pick(0.0, -0.6);
    let other_room = own.region.is_some() && thing.region.is_some() && own.region != thing.region;
    let (at, with) = (walls(facts, own, reading), walls(facts, thing, reading));
    let faces = (0..4).any(|side| at[side] && with[side ^ 1]);
    apart && aligned && !other_room && (faces || reading == Reading::Generous)
}

/// Returns the first word required by `claims` but missing from `text`.
pub(crate) fn unsaid(text: &str, claims: &Claims) -> Option<String> {
    let text = text.to_lowercase();
    let said = |word: &String| text.contains(word) || text.contains(&lexicon::plural(word));
    let head = std::iter::once(claims.head.noun.clone());
    let words = head.chain(claims.list.iter().flat_map(words)).map(|word| word.to_lowercase());
    words.into_iter().find(|word| !said(word))
}

fn words(claim: &Claim) -> Vec<String> {
    match claim {
        Claim::Color(word) | Claim::Shape(word) | Claim::Size(word) => vec![word.clone()],
        // `wool` is in `woollen`, `wood` in `wooden`: both adjective and noun count.
        Claim::Material(word) => vec![lexicon::substance(word).unwrap_or(word).to_owned()],
        Claim::Room(noun) => vec![noun.clone()],
        Claim::Place(relation, landmarks) => {
            let side = side(*relation).map(str::to_owned);
            let named = |mark: &Landmark| mark.color.clone().into_iter().chain([mark.name.noun.clone()]);
            landmarks.iter().flat_map(named).chain(side).collect()
        }
    }
}

fn side(relation: Relation) -> Option<&'static str> {
    match relation {
        Relation::LeftOf => Some("to the left of"),
        Relation::RightOf => Some("to the right of"),
        Relation::Between => Some("between"),
        Relation::Corner => Some("corner"),
        Relation::AgainstWall => Some("wall"),
        _ => None,
    }
}
