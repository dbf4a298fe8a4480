"""Losses: categories, instance centres and instance embeddings."""

import torch
from data import BUILDING, INSTANCES, UNKNOWN
from model import OFFSET_PX
from torch.nn import functional as F

# Fewest output pixels of an instance in the embedding loss.
LEAST_PX = 20
TEMPERATURE = 0.1


def class_weights(frames):
    """Returns weights that raise rare categories and lower common ones."""
    counts = torch.ones(len(frames.categories))
    for records in frames.houses[::4]:
        seen = torch.from_numpy(records["category"][:, ::8, ::8].astype("int64")).flatten()
        counts += torch.bincount(seen[seen != UNKNOWN], minlength=len(counts))
    weights = (counts.median() / counts) ** 0.4
    return weights.clamp(0.25, 3)


def loss(net, out, categories, instances, houses, weights):
    """Returns the total loss and its parts."""
    logits, offsets, embeddings = net.split(out)
    what = F.cross_entropy(logits, categories, weights, ignore_index=UNKNOWN)
    things = (instances > 0) & (categories >= BUILDING) & (categories != UNKNOWN)
    key = instances + INSTANCES * torch.arange(len(instances))[:, None, None]
    keys, index, sizes = key[things].unique(return_inverse=True, return_counts=True)
    where = offset_loss(offsets, things, index, sizes)
    which = embedding_loss(embeddings, things, index, sizes, keys, categories, houses)
    return what + 0.3 * where + 0.2 * which, (what.item(), where.item(), which.item())


def mean_by(values, index, sizes):
    """Averages `values` (count x n) over equal `index`."""
    sums = torch.zeros(len(sizes), values.shape[1]).index_add(0, index, values)
    return sums / sizes[:, None]


def offset_loss(offsets, things, index, sizes):
    """Returns the distance between predicted and true offsets to the centre of the visible part of the instance."""
    rows = torch.arange(things.shape[1])[None, :, None].expand(things.shape)
    columns = torch.arange(things.shape[2])[None, None, :].expand(things.shape)
    places = torch.stack([columns[things], rows[things]], 1).float()
    wanted = (mean_by(places, index, sizes)[index] - places) / OFFSET_PX
    predicted = offsets.permute(0, 2, 3, 1)[things]
    return F.smooth_l1_loss(predicted, wanted, beta=0.25)


def embedding_loss(embeddings, things, index, sizes, keys, categories, houses):
    """Returns the contrastive loss between an instance and others of its category (van den Oord 2018)."""
    means = F.normalize(mean_by(embeddings.permute(0, 2, 3, 1)[things], index, sizes), dim=1)
    kind = mean_by(categories[things].float()[:, None], index, sizes)[:, 0].round()
    owner = houses[keys // INSTANCES] * INSTANCES + keys % INSTANCES
    large = sizes >= LEAST_PX
    means, kind, owner = means[large], kind[large], owner[large]
    itself = torch.eye(len(means), dtype=torch.bool)
    same = (owner[:, None] == owner) & ~itself
    rival = (kind[:, None] == kind) & ~itself
    counted = same.any(1) & (rival & ~same).any(1)
    if not counted.any():
        return means.sum() * 0
    likeness = (means @ means.T / TEMPERATURE).masked_fill(~rival, -1e9)
    predicted = likeness.log_softmax(1)
    return -(predicted * same).sum(1)[counted].div(same.sum(1)[counted]).mean()
