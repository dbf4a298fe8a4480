use crate::{
    cue::Description,
    describe::{
        check::{self, Reading},
        facts::{Claim, Claims, Facts, Relation},
        frames::Frame,
        lexicon::{self, Name},
        phrase::Words,
        relate::Relater,
    },
    survey::{Palette, Sighting, SurveyOptions},
};
use avln_geom::Rng;
use avln_scene::{InstanceId, Object};
use avln_world::SceneAssets;
use std::collections::{BTreeMap, BTreeSet};

/// Attempts at the sentences of one instance.
const ATTEMPTS: usize = 40;
/// Most places in a sentence.
const MAX_PLACES: usize = 3;
/// Share of a picture that a thing fills at least before it is spoken of.
const LANDMARK_SHARE: f32 = 0.004;

/// A sentence and what it claims.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sentence {
    pub(crate) text: String,
    pub(crate) claims: Claims,
    /// The frame that it was made with.
    pub(crate) frame: &'static str,
}

impl From<Sentence> for Description {
    fn from(sentence: Sentence) -> Self {
        Self { text: sentence.text, claims: Some(sentence.claims) }
    }
}

/// Writes the sentences of one scene.
pub(crate) struct Writer<'a> {
    relater: Relater<'a>,
    options: &'a SurveyOptions,
}

/// What can be said of one target.
struct Pool {
    index: usize,
    names: Vec<Name>,
    candidates: Vec<Claim>,
    /// For each candidate, the other objects that it might be said of.
    might_fit: Vec<BTreeSet<usize>>,
    verb: &'static str,
}

impl<'a> Writer<'a> {
    /// A writer for the scene of `assets`, in which each instance was seen in the colours of `palettes`.
    pub(crate) fn new(
        assets: &'a SceneAssets,
        palettes: &'a BTreeMap<InstanceId, Palette>,
        options: &'a SurveyOptions,
    ) -> Self {
        Self { relater: Relater::new(Facts::new(assets, palettes)), options }
    }

    /// Sentences that fit this instance of the scene alone, each with claims and a frame of its own.
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
        let named: BTreeSet<usize> = names
            .iter()
            .flat_map(|name| check::called(facts, &Claims { head: name.clone(), list: Vec::new() }, index))
            .collect();
        let fits = |claim: &Claim| {
            let might = |other: &&usize| check::holds(facts, claim, index, **other, Reading::Generous);
            named.iter().filter(might).copied().collect()
        };
        let might_fit = candidates.iter().map(fits).collect();
        Pool { index, names, verb: self.verb(index, &candidates), candidates, might_fit }
    }

    /// Claims about what the object itself looks like, and its room.
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

    /// Indices of the objects that show in the pictures of an instance.
    fn seen_with(&self, sighting: &Sighting) -> Vec<usize> {
        let mut seen = BTreeSet::new();
        for look in &sighting.looks {
            let enough = LANDMARK_SHARE * (look.view.side_px * look.view.side_px) as f32;
            seen.extend(
                look.beside.iter().filter(|(_, pixels)| **pixels as f32 >= enough).map(|(id, _)| *id),
            );
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
            _ if self.relater.hangs(index) => "hangs",
            _ if LAID.contains(&category) => "is",
            _ => "stands",
        }
    }

    /// One attempt at a sentence: some claims at random, then those that exclude the most rivals until none is left.
    fn attempt(&self, pool: &Pool, rng: &mut Rng) -> Option<Sentence> {
        let head = if rng.chance(0.7) { pool.names.first() } else { rng.choose(&pool.names) }?.clone();
        let empty = Claims { head: head.clone(), list: Vec::new() };
        let mut rivals = check::called(&self.relater.facts, &empty, pool.index);
        let mut chosen = pool.draw(rng);
        for &claim in &chosen {
            rivals.retain(|rival| pool.might_fit[claim].contains(rival));
        }
        while !rivals.is_empty() {
            let next = pool.most_telling(&chosen, &rivals)?;
            rivals.retain(|rival| pool.might_fit[next].contains(rival));
            chosen.push(next);
        }
        chosen.sort_unstable_by_key(|&claim| pool.rank(claim));
        let claims: Vec<Claim> = chosen.iter().map(|&claim| pool.candidates[claim].clone()).collect();
        let claims = Claims { head, list: claims };
        let (text, frame) = self.words(pool, &claims, rng)?;
        let checked = check::fits_only(&self.relater.facts, &claims, pool.index);
        checked.then_some(Sentence { text, claims, frame })
    }

    /// The claims in words, in a frame that gives a sentence of the right length.
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
        let fits = |frame: &Frame| {
            frame.places == words.places.len()
                && frame.room == room.is_some()
                && (!frame.is_predicative() || !words.looks.is_empty())
        };
        let mut frames: Vec<Frame> = Frame::all().filter(fits).collect();
        rng.shuffle(&mut frames);
        let range = self.options.min_words..=self.options.max_words;
        let sentences = frames.iter().map(|frame| (words.fill(frame, rng), frame.text));
        sentences.into_iter().find(|(text, _)| range.contains(&text.split_whitespace().count()))
    }
}

impl Pool {
    /// Some claims to begin with: one to three places, most of what is known of the looks, the room in half the cases.
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

    /// Whether a claim can be said beside others: nothing is spoken of twice, and there are not too many places.
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

    /// The claim that leaves the fewest rivals; `None` when no claim excludes any.
    fn most_telling(&self, chosen: &[usize], rivals: &[usize]) -> Option<usize> {
        let left = |claim: usize| rivals.iter().filter(|rival| self.might_fit[claim].contains(rival)).count();
        let usable = (0..self.candidates.len()).filter(|&claim| self.goes_with(chosen, claim));
        usable
            .map(|claim| (left(claim), claim))
            .filter(|(left, _)| *left < rivals.len())
            .min()
            .map(|(_, claim)| claim)
    }

    /// The order in which claims are said: size, shape, colour, material, room, then places.
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

/// Whether a relation speaks of a wall: one wall in a sentence is enough.
fn is_at_wall(relation: Relation) -> bool {
    use Relation::{AgainstWall, Corner, LeftOf, Opposite, RightOf};
    matches!(relation, LeftOf | RightOf | Opposite | Corner | AgainstWall)
}
