use crate::map::Map;
use crate::shapes::Shapes;
use crate::weights::{About, Layer, Weights, WeightsError};

/// Channels of the input: red, green, blue, depth, height, and whether the last two are known.
pub(crate) const INPUTS: usize = 6;
/// Channels at a half, a quarter, an eighth and a sixteenth of the input's size, and of what the head reads.
const WIDTHS: [usize; 4] = [24, 48, 96, 192];
const LAST: usize = 32;
/// Sides of pictures are multiples of this, pixels.
pub(crate) const MULTIPLE_PX: usize = 16;

/// A U-Net whose skips are added, of 3 × 3 convolutions.
pub(crate) struct Network {
    pub(crate) about: About,
    stem: Layer,
    /// For each size: the convolution on the way down; the first one of the next size.
    levels: [Layer; 4],
    downs: [Layer; 3],
    whole: Layer,
    /// For each size but the smallest: from the next smaller one, and the convolution on the way up.
    lifts: [Layer; 3],
    backs: [Layer; 3],
    head: Layer,
    pub(crate) shapes: Option<Shapes>,
    memory: Memory,
}

/// What a picture of one size needs; kept from picture to picture.
#[derive(Default)]
struct Memory {
    input: Map,
    /// For each size, two maps that take turns.
    levels: [[Map; 2]; 4],
    lifted: [Map; 3],
    last: Map,
    output: Map,
    mean: Vec<f32>,
    sum: Vec<f32>,
}

impl Memory {
    fn new(width: usize, height: usize, outputs: usize) -> Self {
        let (half, level) =
            ([width / 2, height / 2], |level: usize| [width >> (level + 1), height >> (level + 1)]);
        let map = |[width, height]: [usize; 2], channels| Map::new(width, height, channels);
        Self {
            input: map([width, height], INPUTS),
            levels: std::array::from_fn(|n| [map(level(n), WIDTHS[n]), map(level(n), WIDTHS[n])]),
            lifted: std::array::from_fn(|n| map(level(n + 1), WIDTHS[n])),
            last: map(half, LAST),
            output: map(half, outputs),
            ..Self::default()
        }
    }
}

impl Network {
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, WeightsError> {
        let weights = Weights::read(bytes)?;
        let outputs = weights.about.categories.len() + 2 + weights.about.embedding;
        let conv = |name: &str, inputs, outputs| weights.layer(name, 9, inputs, outputs);
        let point = |name: &str, inputs, outputs| weights.layer(name, 1, inputs, outputs);
        let [a, b, c, d] = WIDTHS;
        Ok(Self {
            stem: conv("stem", INPUTS, a)?,
            levels: [
                conv("level_1", a, a)?,
                conv("level_2", b, b)?,
                conv("level_3", c, c)?,
                conv("level_4", d, d)?,
            ],
            downs: [conv("down_2", a, b)?, conv("down_3", b, c)?, conv("down_4", c, d)?],
            whole: point("whole", d, d)?,
            lifts: [point("lift_1", b, a)?, point("lift_2", c, b)?, point("lift_3", d, c)?],
            backs: [conv("back_1", a, LAST)?, conv("back_2", b, b)?, conv("back_3", c, c)?],
            head: point("head", LAST, outputs)?,
            shapes: Shapes::read(&weights)?,
            memory: Memory::default(),
            about: weights.about,
        })
    }

    /// The map to fill before [`Network::run`], for a picture of this size; sides are multiples of [`MULTIPLE_PX`].
    pub(crate) fn input(&mut self, width: usize, height: usize) -> &mut Map {
        let outputs = self.head.bias.len();
        if (self.memory.input.width, self.memory.input.height) != (width, height) {
            self.memory = Memory::new(width, height, outputs);
        }
        &mut self.memory.input
    }

    /// What the network tells of every second pixel: logits of categories, offset to the middle of its instance (x, y), embedding.
    pub(crate) fn run(&mut self) -> &mut Map {
        let Memory { input, levels, lifted, last, output, mean, sum } = &mut self.memory;
        levels[0][0].convolve(input, &self.stem);
        for (level, layer) in self.levels.iter().enumerate() {
            let (finer, here) = levels.split_at_mut(level);
            let [before, after] = &mut here[0];
            if let Some([_, from]) = finer.last() {
                before.convolve(from, &self.downs[level - 1]);
            }
            after.convolve(before, layer);
        }
        let [one, two, three, four] = levels;
        four[1].add_whole(&self.whole, mean, sum);
        let back = |level: usize, lifted: &mut Map, from: &Map, skip: &mut Map, to: &mut Map| {
            lifted.project(from, &self.lifts[level]);
            skip.add_twice(lifted);
            to.convolve(skip, &self.backs[level]);
        };
        let [[three_0, three_1], [two_0, two_1], [_, one_1]] = [three, two, one];
        back(2, &mut lifted[2], &four[1], three_1, three_0);
        back(1, &mut lifted[1], three_0, two_1, two_0);
        back(0, &mut lifted[0], two_0, one_1, last);
        output.project(last, &self.head);
        output
    }

    /// What the last [`Network::run`] told.
    pub(crate) fn output(&mut self) -> &mut Map {
        &mut self.memory.output
    }
}
