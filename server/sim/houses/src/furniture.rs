//! Furniture: each function draws one piece, in its own frame (base on y = 0 unless it hangs, front towards +z),
//! with words that fit what it looks like.

pub(super) mod appliances;
pub(super) mod baths;
pub(super) mod beds;
pub(super) mod boards;
pub(super) mod cabinets;
pub(super) mod chairs;
pub(super) mod chests;
pub(super) mod clothes;
pub(super) mod counters;
pub(super) mod curtains;
pub(super) mod decor;
pub(super) mod floor;
pub(super) mod hearths;
pub(super) mod lights;
pub(super) mod openings;
pub(super) mod parts;
pub(super) mod pictures;
pub(super) mod plants;
pub(super) mod screens;
pub(super) mod shelves;
pub(super) mod sinks;
pub(super) mod sofas;
pub(super) mod sports;
pub(super) mod stools;
pub(super) mod tables;
pub(super) mod towels;
pub(super) mod washing;

#[cfg(test)]
mod tests;

use super::assembly::Piece;
use super::model::{Model, Span, about};
use super::paint::{Paint, Tint};
use super::substance::Substance;
use super::taste::{self, Taste, size_word};
use super::texture::Pattern;
use avln_geom::{Point3, Rng, Vector3, angle};
use avln_scene::Attributes;

/// A kind of furniture: what it is called, which looks it comes in, and how it is drawn.
pub(super) struct Make {
    /// mpcat40 name where there is one.
    pub(super) category: &'static str,
    /// What people call it where the category is a more general word; empty otherwise.
    pub(super) noun: &'static str,
    /// How many shapes `draw` knows.
    pub(super) styles: usize,
    /// The likelier ones first.
    pub(super) substances: &'static [Substance],
    /// Colour words, the likelier ones first.
    pub(super) colors: &'static [&'static str],
    /// Draws the style that the draft asks for; says size and shape.
    pub(super) draw: fn(&mut Draft) -> Words,
}

/// Size word and shape word; empty where nothing is to be said.
pub(super) type Words = [&'static str; 2];

/// A piece of furniture that is being drawn.
pub(super) struct Draft {
    pub(super) m: Model,
    pub(super) rng: Rng,
    pub(super) style: usize,
    pub(super) tint: Tint,
    pub(super) substance: Substance,
    /// The paint of what one notices first.
    pub(super) p: Paint,
    /// The paint of legs, frames and handles.
    pub(super) trim: Paint,
    /// Wished width, height and depth, metres; 0 where it does not matter.
    pub(super) wish: [f32; 3],
    /// Instead of the make's noun.
    pub(super) noun: &'static str,
    /// Instead of the substance's word.
    pub(super) material: &'static str,
}

impl Draft {
    /// A length in [`low`, `high`), in whole centimetres.
    pub(super) fn len(&mut self, low: f32, high: f32) -> f32 {
        (self.rng.range(low, high) * 100.0).round() / 100.0
    }

    /// The wished width, or one in the range.
    pub(super) fn width(&mut self, low: f32, high: f32) -> f32 {
        let drawn = self.len(low, high);
        if self.wish[0] > 0.0 { self.wish[0] } else { drawn }
    }

    /// The wished height, or one in the range.
    pub(super) fn height(&mut self, low: f32, high: f32) -> f32 {
        let drawn = self.len(low, high);
        if self.wish[1] > 0.0 { self.wish[1] } else { drawn }
    }

    /// The wished depth, or one in the range.
    pub(super) fn depth(&mut self, low: f32, high: f32) -> f32 {
        let drawn = self.len(low, high);
        if self.wish[2] > 0.0 { self.wish[2] } else { drawn }
    }

    /// Whether its main part is stuffed or draped.
    pub(super) fn soft(&self) -> bool {
        self.substance.is_soft()
    }

    /// Whether it is so dark that bright parts would outshine its colour.
    pub(super) fn dark(&self) -> bool {
        self.p.brightness() < 0.3
    }

    /// Bare metal for taps, pipes and handles.
    pub(super) fn metal(&self) -> Paint {
        if self.dark() { Paint::CHROME.times(0.4) } else { Paint::CHROME }
    }

    /// A box of the main paint: stuffed where the substance is, with fine bevels otherwise.
    pub(super) fn pad(&mut self, x: Span, y: Span, z: Span) {
        let bevel = if self.soft() { 0.035 } else { 0.006 };
        self.m.soft(x, y, z, bevel, self.p);
    }

    /// A plain box of the main paint.
    pub(super) fn board(&mut self, x: Span, y: Span, z: Span) {
        self.m.block(x, y, z, self.p);
    }
}

/// All choices that pieces of one set share.
#[derive(Clone)]
pub(super) struct Look {
    pub(super) rng: Rng,
    pub(super) style: usize,
    pub(super) substance: Substance,
    pub(super) tint: Tint,
    pub(super) trim: Paint,
}

/// A paint for legs and frames that does not outshine or dim what they carry.
fn trim(rng: &mut Rng, main: Paint) -> Paint {
    let paints: &[Paint] = match main.brightness() {
        dark if dark < 0.3 => &[Paint::WALNUT, Paint::DARK_METAL],
        bright if bright > 0.75 => &[Paint::OAK, Paint::STEEL, Paint::BRASS],
        _ => &[Paint::OAK, Paint::WALNUT, Paint::STEEL, Paint::DARK_METAL, Paint::BRASS],
    };
    *rng.choose(paints).expect("there are some")
}

impl Make {
    /// A look that it comes in.
    pub(super) fn look(&self, taste: &mut Taste) -> Look {
        let style = taste.style(self.styles);
        let (substance, tint) = taste.look(self.category, style, self.substances, self.colors);
        let trim = trim(&mut taste.rng, substance.paint(tint));
        Look { rng: taste.rng.fork(self.category), style, substance, tint, trim }
    }

    /// A piece of any size that suits.
    pub(super) fn any(&self, taste: &mut Taste) -> Piece {
        self.sized(taste, [0.0; 3])
    }

    /// A piece of about the given width, height and depth, where they are not 0 and the make heeds them.
    pub(super) fn sized(&self, taste: &mut Taste, wish: [f32; 3]) -> Piece {
        let look = self.look(taste);
        self.drawn(&look, wish)
    }

    /// The piece with all choices made.
    pub(super) fn drawn(&self, look: &Look, wish: [f32; 3]) -> Piece {
        let Look { rng, style, substance, tint, trim } = look.clone();
        let p = substance.paint(tint);
        let (noun, material) = (self.noun, substance.word());
        let mut draft = Draft { m: Model::new(), rng, style, tint, substance, p, trim, wish, noun, material };
        let [size, shape] = (self.draw)(&mut draft);
        let said = |word: &str| word.to_owned();
        let attributes = Attributes {
            noun: said(draft.noun),
            color: said(tint.word),
            material: said(draft.material),
            size: said(size),
            shape: said(shape),
        };
        Piece::new(self.category, draft.m, attributes)
    }
}
