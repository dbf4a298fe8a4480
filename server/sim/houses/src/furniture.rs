//! Furniture. Every function draws a piece in its own frame (base at y = 0 unless it hangs, front towards +z)
//! and returns matching words.

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

/// A furniture kind: names, variants, and drawing function.
pub(super) struct Make {
    /// Category name, from mpcat40 if possible.
    pub(super) category: &'static str,
    /// Common name if the category is more general; otherwise empty.
    pub(super) noun: &'static str,
    /// Number of shapes in `draw`.
    pub(super) styles: usize,
    /// The likelier ones first.
    pub(super) substances: &'static [Substance],
    /// Colour words, the likelier ones first.
    pub(super) colors: &'static [&'static str],
    /// Draws the style of the draft; returns size and shape words.
    pub(super) draw: fn(&mut Draft) -> Words,
}

/// Size word and shape word; may be empty.
pub(super) type Words = [&'static str; 2];

/// A piece of furniture that is being drawn.
pub(super) struct Draft {
    pub(super) m: Model,
    pub(super) rng: Rng,
    pub(super) style: usize,
    pub(super) tint: Tint,
    pub(super) substance: Substance,
    /// Main paint.
    pub(super) p: Paint,
    /// The paint of legs, frames and handles.
    pub(super) trim: Paint,
    /// Requested width, height and depth, metres; 0 for any.
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

    /// The requested width, or a random width in the range.
    pub(super) fn width(&mut self, low: f32, high: f32) -> f32 {
        let drawn = self.len(low, high);
        if self.wish[0] > 0.0 { self.wish[0] } else { drawn }
    }

    /// The requested height, or a random height in the range.
    pub(super) fn height(&mut self, low: f32, high: f32) -> f32 {
        let drawn = self.len(low, high);
        if self.wish[1] > 0.0 { self.wish[1] } else { drawn }
    }

    /// The requested depth, or a random depth in the range.
    pub(super) fn depth(&mut self, low: f32, high: f32) -> f32 {
        let drawn = self.len(low, high);
        if self.wish[2] > 0.0 { self.wish[2] } else { drawn }
    }

    /// Returns true if the main part is upholstered or draped.
    pub(super) fn soft(&self) -> bool {
        self.substance.is_soft()
    }

    /// Returns true for a dark paint, which bright parts would dominate.
    pub(super) fn dark(&self) -> bool {
        self.p.brightness() < 0.3
    }

    /// Bare metal for taps, pipes and handles.
    pub(super) fn metal(&self) -> Paint {
        if self.dark() { Paint::CHROME.times(0.4) } else { Paint::CHROME }
    }

    /// A box in the main paint: upholstered for soft substances, otherwise with fine bevels.
    pub(super) fn pad(&mut self, x: Span, y: Span, z: Span) {
        let bevel = if self.soft() { 0.035 } else { 0.006 };
        self.m.soft(x, y, z, bevel, self.p);
    }

    /// A plain box of the main paint.
    pub(super) fn board(&mut self, x: Span, y: Span, z: Span) {
        self.m.block(x, y, z, self.p);
    }
}

/// Common choices of a furniture set.
#[derive(Clone)]
pub(super) struct Look {
    pub(super) rng: Rng,
    pub(super) style: usize,
    pub(super) substance: Substance,
    pub(super) tint: Tint,
    pub(super) trim: Paint,
}

/// A paint for legs and frames that matches the brightness of the main paint.
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

    /// A piece with an approximate width, height and depth; zeros are free.
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
