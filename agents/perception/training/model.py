"""The network: RGB-D input; categories, offsets to instance centres and embeddings at half the resolution."""

import torch
from torch import nn
from torch.nn import functional as F

INPUTS = 6
WIDTHS = (24, 48, 96, 192)
EMBEDDING = 12
# Unit of predicted offsets, output pixels.
OFFSET_PX = 16.0


class Block(nn.Module):
    """A 3x3 convolution with batch normalisation (folded on export) and rectification."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1):
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.norm = nn.BatchNorm2d(outputs)

    def forward(self, x):
        return F.relu(self.norm(self.conv(x)))


class VisionNetwork(nn.Module):
    """A U-Net with additive skips; `categories + 2 + EMBEDDING` numbers for every second pixel."""

    def __init__(self, categories: int):
        super().__init__()
        a, b, c, d = WIDTHS
        self.categories = categories
        self.stem = Block(INPUTS, a, 2)
        self.level_1 = Block(a, a)
        self.down_2, self.level_2 = Block(a, b, 2), Block(b, b)
        self.down_3, self.level_3 = Block(b, c, 2), Block(c, c)
        self.down_4, self.level_4 = Block(c, d, 2), Block(d, d)
        self.whole = nn.Conv2d(d, d, 1)
        self.lift_3, self.back_3 = nn.Conv2d(d, c, 1), Block(c, c)
        self.lift_2, self.back_2 = nn.Conv2d(c, b, 1), Block(b, b)
        self.lift_1, self.back_1 = nn.Conv2d(b, a, 1), Block(a, 32)
        self.head = nn.Conv2d(32, categories + 2 + EMBEDDING, 1)

    def forward(self, x):
        one = self.level_1(self.stem(x))
        two = self.level_2(self.down_2(one))
        three = self.level_3(self.down_3(two))
        four = self.level_4(self.down_4(three))
        # The mean over the image adds context to all parts.
        four = four + self.whole(four.mean((2, 3), keepdim=True))
        three = self.back_3(twice(self.lift_3(four)) + three)
        two = self.back_2(twice(self.lift_2(three)) + two)
        one = self.back_1(twice(self.lift_1(two)) + one)
        return self.head(one)

    def split(self, out):
        """Splits the output into logits, offsets (x, y) and embeddings."""
        return out.split([self.categories, 2, EMBEDDING], 1)


def twice(x):
    return F.interpolate(x, scale_factor=2, mode="nearest")


def channels(rgb, depth_m, height_m):
    """Returns the network input: colours around 0, depth, height above the floor, and a mask of known depth.

    rgb: N x 3 x S x S, 0 to 1; depth_m and height_m: N x 1 x S x S, with depth 0 if unknown.
    """
    known = (depth_m > 0).to(rgb.dtype)
    return torch.cat([(rgb - 0.5) * 4, known * depth_m / 4, known * (height_m - 1), known], 1)
