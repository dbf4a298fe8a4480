//! Sentences for a target: candidate claims, checked to be unambiguous.

use crate::{
    cue::{Claim, Claims, Description, Name, Relation},
    describe::{
        check::{self, Reading},
        lexicon,
        phrase::{SentenceFrame, Words},
        relate::{Facts, Relater},
    },
    survey::{Sighting, SurveyOptions, look::Palette},
};
use avln_geom::Rng;
use avln_scene::{InstanceId, Object};
use avln_world::SceneAssets;
use std::collections::{BTreeMap, BTreeSet};

const ATTEMPTS: usize = 40;
const MAX_PLACES: usize = 3;
/// Least pixel share for landmarks.
const LANDMARK_SHARE: f32 = 0.004;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sentence {
    pub(crate) text: String,
    pub(crate) claims: Claims,
    pub(crate) frame: &'static str,
}

impl From<Sentence> for Description {
    fn from(sentence: Sentence) -> Self {
        Self { text: sentence.text, claims: Some(sentence.claims) }
    }
}

pub(crate) struct Writer<'a> {
    relater: Relater<'a>,
    options: &'a SurveyOptions,
}

struct Pool {
    index: usize,
    names: Vec<Name>,
    candidates: Vec<Claim>,
    /// Per claim: other matching objects.
    might_fit: Vec<BTreeSet<usize>>,
    verb: &'static str,
}

impl<'a> Writer<'a> {
    pub(crate) fn new(
        assets: &'a SceneAssets,
        palettes: &'a BTreeMap<InstanceId, Palette>,
        options: &'a SurveyOptions,
    ) -> Self {
        Self { relater: Relater::new(Facts::new(assets, palettes)), options }
    }

    /// Returns unambiguous sentences for an instance, with different claims and frames.
    pub(crate) fn sentences(&self, sighting: &Sighting, mut rng: Rng) -> Vec<Sentence> {
        let pool = self.pool(sighting);
        let mut said: Vec<Sentence> = Vec::new();
        for _ in 0..ATTEMPTS {
            if said.len() == self.options.sentences {
                break;
            }
            let differs =
                |new: &Sentence| said.iter().all(|old| old.claims != new.claims && old.frame != new.frame);
            let sentence = self.attempt(&pool, &mut rng).filter(differs);
            said.extend(sentence);
        }
        said
    }

    fn pool(&self, sighting: &Sighting) -> Pool {
        let facts = &self.relater.facts;
        let index = sighting.index;
        let object = &facts.scene.objects[index];
        let names = lexicon::names(object);
        let mut candidates = self.looks(object);
        candidates.extend(self.relater.places(index, &self.seen_with(sighting)));
        candidates.retain(|claim| check::holds(facts, claim, index, index, Reading::Plain));
        let named: BTreeSet<usize> =
            names.iter().flat_map(|name| check::called(facts, name, index)).collect();
        let fits = |claim: &Claim| {
            let might = |other: &&usize| check::holds(facts, claim, index, **other, Reading::Generous);
            named.iter().filter(might).copied().collect()
        };
        let might_fit = candidates.iter().map(fits).collect();
        Pool { index, names, verb: self.verb(index, &candidates), candidates, might_fit }
    }

    fn looks(&self, object: &Object) -> Vec<Claim> {
        let facts = &self.relater.facts;
        let owned = |word: &str| word.to_owned();
        let claims = [
            lexicon::size_word(object).map(owned).map(Claim::Size),
            lexicon::shape_word(object).map(owned).map(Claim::Shape),
            facts.color_of(object).map(owned).map(Claim::Color),
            lexicon::material_word(object).map(owned).map(Claim::Material),
            facts.room_of(object).map(Claim::Room),
        ];
        claims.into_iter().flatten().collect()
    }

    /// Indices of objects visible in pictures with the instance.
    fn seen_with(&self, sighting: &Sighting) -> Vec<usize> {
        let mut seen = BTreeSet::new();
        for look in &sighting.looks {
            let enough = LANDMARK_SHARE * (look.view.side_px * look.view.side_px) as f32;
            let clear = look.beside.iter().filter(|(_, pixels)| **pixels as f32 >= enough);
            seen.extend(clear.map(|(id, _)| *id));
        }
        let objects = &self.relater.facts.scene.objects;
        seen.iter().filter_map(|id| objects.binary_search_by_key(id, |object| object.id).ok()).collect()
    }

    fn verb(&self, index: usize, candidates: &[Claim]) -> &'static str {
        const BUILT_IN: &[&str] =
            &["counter", "sink", "toilet", "bathtub", "shower", "fireplace", "gym_equipment"];
        const LAID: &[&str] = &["cushion", "towel", "clothes"];
        let object = &self.relater.facts.scene.objects[index];
        let category = object.category.as_str();
        let on = candidates.iter().any(|claim| matches!(claim, Claim::Place(Relation::On, _)));
        match category {
            _ if on && LAID.contains(&category) => "lies",
            _ if BUILT_IN.contains(&category) => "is",
            _ if self.relater.hangs[index] => "hangs",
            _ if LAID.contains(&category) => "is",
            _ => "stands",
        }
    }

    /// Tries a sentence: random claims, then the most selective ones until no rival remains.
    fn attempt(&self, pool: &Pool, rng: &mut Rng) -> Option<Sentence> {
        let head = if rng.chance(0.7) { pool.names.first() } else { rng.choose(&pool.names) }?.clone();
        let mut rivals = check::called(&self.relater.facts, &head, pool.index);
        let mut chosen = pool.draw(rng);
        for &claim in &chosen {
            rivals.retain(|rival| pool.might_fit[claim].contains(rival));
        }
        // Random claims add variety; the greedy rest makes sentences short.
        while !rivals.is_empty() {
            let next = pool.most_telling(&chosen, &rivals)?;
            rivals.retain(|rival| pool.might_fit[next].contains(rival));
            chosen.push(next);
        }
        chosen.sort_unstable_by_key(|&claim| pool.rank(claim));
        let claims: Vec<Claim> = chosen.iter().map(|&claim| pool.candidates[claim].clone()).collect();
        let claims = Claims { head, list: claims };
        let (text, frame) = self.words(pool, &claims, rng)?;
        // The checker implements relations a second time: an error in either rejects the sentence.
        let checked = check::fits_only(&self.relater.facts, &claims, pool.index);
        checked.then_some(Sentence { text, claims, frame })
    }

    /// Words for the claims, in a frame with an allowed length.
    fn words(&self, pool: &Pool, claims: &Claims, rng: &mut Rng) -> Option<(String, &'static str)> {
        let is_place = |claim: &&Claim| matches!(claim, Claim::Place(..));
        let room = claims.list.iter().find_map(|claim| match claim {
            Claim::Room(noun) => Some((noun.as_str(), self.relater.facts.rooms_called(noun) < 2)),
            _ => None,
        });
        let is_look = |claim: &&Claim| !matches!(claim, Claim::Place(..) | Claim::Room(_));
        let words = Words {
            noun: &claims.head.noun,
            looks: claims.list.iter().filter(is_look).collect(),
            places: claims.list.iter().filter(is_place).collect(),
            room,
            verb: pool.verb,
        };
        let fits = |frame: &SentenceFrame| {
            frame.places() == words.places.len()
                && frame.has_room() == room.is_some()
                && (!frame.is_predicative() || !words.looks.is_empty())
        };
        let mut frames: Vec<SentenceFrame> = SentenceFrame::all().filter(fits).collect();
        rng.shuffle(&mut frames);
        let range = self.options.min_words..=self.options.max_words;
        let sentences = frames.into_iter().map(|frame| (words.fill(frame, rng), frame.0));
        sentences.into_iter().find(|(text, _)| range.contains(&text.split_whitespace().count()))
    }
}

impl Pool {
    /// Random initial claims: one to three locations, most of the appearance, the room in half the cases.
    fn draw(&self, rng: &mut Rng) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.candidates.len()).collect();
        rng.shuffle(&mut order);
        let places = 1 + usize::from(rng.chance(0.6)) + usize::from(rng.chance(0.35));
        let mut chosen = Vec::new();
        for claim in order {
            let wanted = match self.candidates[claim] {
                Claim::Color(_) => rng.chance(0.85),
                Claim::Room(_) => rng.chance(0.45),
                Claim::Place(..) => self.places_in(&chosen) < places,
                _ => rng.chance(0.55),
            };
            if wanted && self.goes_with(&chosen, claim) {
                chosen.push(claim);
            }
        }
        let is_look = |&claim: &usize| self.rank(claim).0 < 4;
        if !chosen.iter().any(is_look) {
            chosen.extend((0..self.candidates.len()).filter(is_look).nth(rng.below(2)));
        }
        chosen
    }

    fn places_in(&self, chosen: &[usize]) -> usize {
        chosen.iter().filter(|&&claim| matches!(self.candidates[claim], Claim::Place(..))).count()
    }

    /// True if a claim is compatible with the chosen ones: no repetition, limited locations.
    fn goes_with(&self, chosen: &[usize], claim: usize) -> bool {
        let Claim::Place(relation, landmarks) = &self.candidates[claim] else {
            return !chosen.contains(&claim);
        };
        let clashes = |&other: &usize| match &self.candidates[other] {
            Claim::Place(said, spoken_of) => {
                let twice =
                    landmarks.iter().any(|mark| spoken_of.iter().any(|m| m.name.noun == mark.name.noun));
                twice || said == relation || (is_at_wall(*said) && is_at_wall(*relation))
            }
            _ => false,
        };
        self.places_in(chosen) < MAX_PLACES && !chosen.iter().any(clashes)
    }

    /// Claim that leaves the fewest rivals; `None` if no claim excludes any.
    fn most_telling(&self, chosen: &[usize], rivals: &[usize]) -> Option<usize> {
        let left = |claim: usize| rivals.iter().filter(|rival| self.might_fit[claim].contains(rival)).count();
        let usable = (0..self.candidates.len()).filter(|&claim| self.goes_with(chosen, claim));
        let (left, claim) = usable.map(|claim| (left(claim), claim)).min()?;
        (left < rivals.len()).then_some(claim)
    }

    /// Claim order: size, shape, colour, material, room, locations.
    fn rank(&self, claim: usize) -> (u8, Option<Relation>) {
        match &self.candidates[claim] {
            Claim::Size(_) => (0, None),
            Claim::Shape(_) => (1, None),
            Claim::Color(_) => (2, None),
            Claim::Material(_) => (3, None),
            Claim::Room(_) => (4, None),
            Claim::Place(relation, _) => (5, Some(*relation)),
        }
    }
}

/// True if a relation mentions a wall: a sentence has at most one such relation.
fn is_at_wall(relation: Relation) -> bool {
    use Relation::{AgainstWall, Corner, LeftOf, Opposite, RightOf};
    matches!(relation, LeftOf | RightOf | Opposite | Corner | AgainstWall)
}
