use crate::feature_map::FeatureMap;
use crate::picture::INPUTS;
use crate::shapes::ShapeClassifier;
use crate::weights::{ConvLayer, NetworkInfo, WeightsError, WeightsFile};

/// Channels at 1/2, 1/4, 1/8 and 1/16 size, and in the head's input.
const WIDTHS: [usize; 4] = [24, 48, 96, 192];
const LAST: usize = 32;

/// A U-Net of 3 × 3 convolutions with additive skips.
pub(crate) struct UNet {
    pub(crate) info: NetworkInfo,
    stem: ConvLayer,
    /// Convolutions by level on the way down, and strided convolutions between levels.
    levels: [ConvLayer; 4],
    downs: [ConvLayer; 3],
    whole: ConvLayer,
    /// Projections from the next smaller level, and convolutions on the way up.
    lifts: [ConvLayer; 3],
    backs: [ConvLayer; 3],
    head: ConvLayer,
    pub(crate) shapes: Option<ShapeClassifier>,
    memory: UNetBuffers,
}

/// The buffers for an input size.
#[derive(Default)]
struct UNetBuffers {
    input: FeatureMap,
    /// Two alternating maps per level.
    levels: [[FeatureMap; 2]; 4],
    lifted: [FeatureMap; 3],
    last: FeatureMap,
    output: FeatureMap,
    mean: Vec<f32>,
    sum: Vec<f32>,
}

impl UNetBuffers {
    fn new(width: usize, height: usize, outputs: usize) -> Self {
        let (half, level) =
            ([width / 2, height / 2], |level: usize| [width >> (level + 1), height >> (level + 1)]);
        let map = |[width, height]: [usize; 2], channels| FeatureMap::new(width, height, channels);
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

impl UNet {
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, WeightsError> {
        let weights = WeightsFile::read(bytes)?;
        let outputs = weights.info.categories.len() + 2 + weights.info.embedding;
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
            shapes: ShapeClassifier::read(&weights)?,
            memory: UNetBuffers::default(),
            info: weights.info,
        })
    }

    /// Returns the input map for an image size, in multiples of [`MULTIPLE_PX`](crate::picture::MULTIPLE_PX).
    pub(crate) fn input(&mut self, width: usize, height: usize) -> &mut FeatureMap {
        let outputs = self.head.bias.len();
        // Buffers are reused: sizes rarely change within a run.
        if (self.memory.input.width, self.memory.input.height) != (width, height) {
            self.memory = UNetBuffers::new(width, height, outputs);
        }
        &mut self.memory.input
    }

    /// Runs the network. The output has every second pixel: category logits, offset (x, y) to the instance centre,
    /// embedding.
    pub(crate) fn run(&mut self) -> &mut FeatureMap {
        let UNetBuffers { input, levels, lifted, last, output, mean, sum } = &mut self.memory;
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
        let back = |level: usize,
                    lifted: &mut FeatureMap,
                    from: &FeatureMap,
                    skip: &mut FeatureMap,
                    to: &mut FeatureMap| {
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

    /// Returns the last output.
    pub(crate) fn output(&mut self) -> &mut FeatureMap {
        &mut self.memory.output
    }
}
