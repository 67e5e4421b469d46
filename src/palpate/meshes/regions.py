"""Regions that meet, or that reach the skin: which tets are whose, and the faces between them moved to the boundary.

Cutting tets keeps its angles only where one surface passes at a time. Where regions meet, the tets stay whole: each
goes to the region that fills most of it, and the nodes between regions then move onto the boundary as far as the angles
bear. So it never fails; what it costs is that a boundary between regions may be off by part of an edge.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Bool, Float64, Int64
from palpate.meshes.lattice import edges_of
from palpate.meshes.levels import Level
from palpate.meshes.manifold import face_neighbours, unpinched
from palpate.meshes.mesh import signed_volumes
from palpate.meshes.shape import smallest_dihedral
from palpate.meshes.solids import Solid

LEAST = 14.0  # degrees: no tet falls below this, or below what it had, when its nodes move
FURTHEST = 0.45  # of an edge: how far a node goes from where the lattice put it
ROUNDS = 12
SAMPLES = 200_000  # points at which volumes are weighed
# Halfway from the middle of a tet to its corners, and the middle: where a tet asks whose it is.
INNER = np.vstack([np.full((1, 4), 0.25), np.full((4, 4), 0.125) + 0.5 * np.eye(4)])


@dataclass(frozen=True, eq=False)
class Shares:
    """How much of each region is where: smoothed masks over their sum.

    levels: one a region; bias: (R,) added to each share, so that regions get their volumes.
    """

    levels: Sequence[Level]
    bias: Float64

    def __call__(self, points: Float64) -> Float64:
        """(N, R) at (N, 3) mm; the largest owns the point."""
        parts = np.stack([level(points) + level.level for level in self.levels], axis=1)
        return parts / np.maximum(parts.sum(axis=1, keepdims=True), 1e-9) + self.bias


def divided(bodies: Sequence[Solid], width: Float64, skin: Level, nodes: Float64, tets: Int64, edge: float) -> tuple[Float64, Int64]:
    """Nodes (N, 3) mm, moved, and the body (M,) of each tet of a mesh of the first body, whose surface is `skin`.

    width: (3,) mm, standard deviation of the smoothing along z, y, x. Volumes are those of the voxels as near as whole
    tets and moved nodes come.
    """
    owner = np.zeros(bodies[0].mask.shape, dtype=np.int64)
    for number, body in enumerate(bodies):
        owner[body.mask] = number
    inside = bodies[0].mask
    spacing = bodies[0].grid.spacing
    levels = [Level(inside & (owner == k), spacing, width) for k in range(len(bodies))]
    wanted = np.bincount(owner[inside], minlength=len(bodies)).astype(float)
    wanted /= wanted.sum()
    strewn = _strewn(inside, spacing)
    aim, best, off = wanted.copy(), None, np.inf
    owned: Int64 = np.zeros(len(tets), dtype=np.int64)
    for attempt in range(5):
        shares = Shares(levels, np.zeros(len(bodies)))
        shares = Shares(levels, _bias(shares(strewn), aim))
        if attempt == 0:
            owned = _cleaned(tets, signed_volumes(nodes, tets), _owned(shares, nodes, tets))
        moved = _moved(shares, skin, nodes, tets, owned, edge)
        made = np.bincount(owned, weights=signed_volumes(moved, tets), minlength=len(bodies))
        made /= made.sum()
        error = float(np.abs(made / wanted - 1).max())
        if error < off:
            best, off = moved, error
        if off < 0.005 or (made == 0).any():
            break
        aim = aim * np.clip(wanted / made, 0.8, 1.25)
        aim /= aim.sum()
    assert best is not None
    return best, owned


def _strewn(mask: Bool, spacing: Sequence[float]) -> Float64:
    """(S, 3) mm: points spread evenly over the voxels of a mask."""
    index = np.argwhere(mask)
    rng = np.random.default_rng(0)
    index = index[rng.integers(0, len(index), SAMPLES)]
    points: Float64 = (index + rng.uniform(-0.5, 0.5, index.shape))[:, ::-1] * np.array(spacing)[::-1]
    return points


def _bias(shares: Float64, wanted: Float64) -> Float64:
    """(R,) to add to shares (S, R) so that region r is the largest at `wanted` r of the points."""
    bias = np.zeros(shares.shape[1])
    step = 0.2
    for _ in range(40):
        made = np.bincount(np.argmax(shares + bias, axis=1), minlength=len(bias)) / len(shares)
        bias += np.clip(step * np.log(np.maximum(wanted, 1e-6) / np.maximum(made, 1e-6)), -0.1, 0.1)
        bias -= bias.mean()
        step *= 0.93
    return bias


def _owned(shares: Shares, nodes: Float64, tets: Int64) -> Int64:
    """(M,) the region that fills most of each tet."""
    x = nodes[tets]
    total = np.zeros((len(tets), len(shares.levels)))
    for weights in INNER:
        total += np.clip(shares(np.einsum("j,mjk->mk", weights, x)), -1, 1)
    return np.argmax(total, axis=1)


def _cleaned(tets: Int64, volume: Float64, owned: Int64) -> Int64:
    """Tets that stick out with three faces go to the region around them; skins of regions become 2-manifolds."""
    owned = owned.copy()
    pairs = face_neighbours(tets)
    regions = int(owned.max()) + 1
    for _ in range(4):
        votes = np.zeros((len(tets), regions), dtype=np.int64)
        for one, other in ((0, 1), (1, 0)):
            np.add.at(votes, (pairs[:, one], owned[pairs[:, other]]), 1)
        lonely = np.flatnonzero(votes.max(axis=1) >= 3)
        lonely = lonely[np.argmax(votes[lonely], axis=1) != owned[lonely]]
        lonely = lonely[votes[lonely, owned[lonely]] <= 1]
        owned[lonely] = np.argmax(votes[lonely], axis=1)
        for region in range(regions):
            here = np.flatnonzero(owned == region)
            loose = here[~unpinched(tets[here], volume[here])] if len(here) else here
            votes[loose, region] = -1
            owned[loose] = np.argmax(votes[loose], axis=1)
    return owned


def _moved(shares: Shares, skin: Level, nodes: Float64, tets: Int64, owned: Int64, edge: float) -> Float64:
    """(N, 3) mm: nodes between regions on the boundary, those inside eased after them, those of the skin along it."""
    touches = np.zeros((len(nodes), len(shares.levels)), dtype=bool)
    touches[tets.ravel(), np.repeat(owned, 4)] = True
    outer = np.zeros(len(nodes), dtype=bool)
    outer[_skin_nodes(tets)] = True
    between = np.flatnonzero(touches.sum(axis=1) > 1)
    within = np.setdiff1d(np.flatnonzero(touches.any(axis=1)), np.union1d(between, np.flatnonzero(outer)))
    pairs = edges_of(tets)
    fence = pairs[(touches[pairs[:, 0]] & touches[pairs[:, 1]]).sum(axis=1) > 1]
    along_skin = outer[fence].all(axis=1)
    # What lies on the skin is eased by its neighbours there only, what lies inside by all.
    eased_between = _mean_of_neighbours(len(nodes), np.concatenate([fence[along_skin | ~outer[fence[:, 0]]], fence[along_skin | ~outer[fence[:, 1]]][:, ::-1]]))
    eased_within = _mean_of_neighbours(len(nodes), np.concatenate([pairs, pairs[:, ::-1]]))
    start = smallest_dihedral(nodes, tets)
    bound = np.minimum(start, LEAST) - 1e-9
    x = nodes.copy()
    for attempt in range(ROUNDS):
        wish = x.copy()
        ease = 0.5 if attempt < ROUNDS // 2 else 0.15
        wish[between] += ease * (eased_between(x) - x)[between]
        wish[within] += 0.3 * (eased_within(x) - x)[within]
        wish[between] += _onto(shares, skin, wish[between], touches[between], outer[between], edge)
        step = wish - nodes
        far = np.linalg.norm(step, axis=1, keepdims=True) / (FURTHEST * edge)
        wish = nodes + step / np.maximum(far, 1)
        x = _guarded(x, wish, tets, bound)
    return x


def _skin_nodes(tets: Int64) -> Int64:
    from palpate.meshes.mesh import boundary_faces

    return np.unique(boundary_faces(tets.astype(np.int32))).astype(np.int64)


def _mean_of_neighbours(count: int, ends: Int64) -> Callable[[Float64], Float64]:
    """A function of (N, 3) that gives the mean of what each node is joined to; itself where it is joined to none."""
    from scipy.sparse import coo_matrix

    links = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count)).tocsr()
    many = np.asarray(links.sum(axis=1)).ravel()

    def mean(x: Float64) -> Float64:
        answer: Float64 = np.where(many[:, None] > 0, (links @ x) / np.maximum(many, 1)[:, None], x)
        return answer

    return mean


def _onto(shares: Shares, skin: Level, x: Float64, touches: Bool, outer: Bool, edge: float) -> Float64:
    """(N, 3) mm, the smallest step to where all regions that a node touches have equal shares, along the skin on it.

    Newton's step for as many equations as regions, less one; least squares where they contradict each other.
    """
    if len(x) == 0:
        return x
    reach = 0.5 * float(shares.levels[0].spacing.min())

    def values(points: Float64) -> Float64:
        share = shares(points)
        mean = (share * touches).sum(axis=1, keepdims=True) / touches.sum(axis=1, keepdims=True)
        return np.concatenate([np.where(touches, share - mean, 0), np.where(outer, skin(points), 0)[:, None]], axis=1)

    here = values(x)
    slope = np.stack([(values(x + d) - values(x - d)) / (2 * reach) for d in reach * np.eye(3)], axis=2)
    step: Float64 = -np.einsum("nij,nj->ni", np.linalg.pinv(slope, rcond=0.15), here)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return np.asarray(step / np.maximum(length / (0.25 * edge), 1))


def _guarded(x: Float64, wish: Float64, tets: Int64, bound: Float64) -> Float64:
    """Moves nodes as far towards `wish` as leaves every angle above its bound: steps at bad tets halve, then stop."""
    part = np.ones(len(x))
    moving = (wish != x).any(axis=1)
    near = np.flatnonzero(moving[tets].any(axis=1))
    for attempt in range(8):
        there = x + part[:, None] * (wish - x)
        bad = near[(smallest_dihedral(there, tets[near]) < bound[near]) | (signed_volumes(there, tets[near]) <= 0)]
        if len(bad) == 0:
            return there
        part[np.unique(tets[bad])] *= 0.5 if attempt < 3 else 0
    return x
