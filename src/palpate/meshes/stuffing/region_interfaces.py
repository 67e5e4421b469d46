"""Regions that meet, or that reach the skin: which tets are whose, and the faces between them moved to the boundary.

Cutting tets keeps its angles only where one surface passes at a time. Where regions meet, the tets stay whole: each
goes to the region that fills most of it, and the nodes between regions then move onto the boundary as far as the angles
bear. So it never fails; what it costs is that a boundary between regions may be off by part of an edge.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Bool, Float64, Int64
from palpate.errors import MeshError
from palpate.meshes.element_quality import smallest_dihedral
from palpate.meshes.stuffing.bcc_lattice import edges_of
from palpate.meshes.stuffing.level_set import Level
from palpate.meshes.stuffing.manifold_repair import remove_pinches
from palpate.meshes.stuffing.nested_solids import Solid
from palpate.meshes.stuffing.volume_matching import empty_body_message
from palpate.meshes.tet_mesh import boundary_faces, shared_faces, signed_volumes

LEAST = 14.0  # degrees: no tet falls below this, or below what it had, when its nodes move
FURTHEST = 0.45  # of an edge: how far a node goes from where the lattice put it
ROUNDS = 8
SAMPLES = 100_000  # points at which volumes are weighed
# Halfway from the middle of a tet to its corners, and the middle: where a tet asks whose it is.
INNER = np.vstack([np.full((1, 4), 0.25), np.full((4, 4), 0.125) + 0.5 * np.eye(4)])


@dataclass(frozen=True, eq=False)
class Shares:
    """Share of each region at a point: smoothed masks divided by their sum.

    levels: one a region; bias: (R,) added to each share, so that regions get their volumes.
    """

    levels: Sequence[Level]
    bias: Float64

    def __call__(self, points: Float64) -> Float64:
        """(N, R) at (N, 3) mm; the largest owns the point."""
        parts = np.stack([level(points) + level.level for level in self.levels], axis=1)
        shares: Float64 = parts / np.maximum(parts.sum(axis=1, keepdims=True), 1e-9) + self.bias
        return shares


def touching(bodies: Sequence[Solid], edges: Sequence[float]) -> bool:
    """Whether two surfaces come so close that they are sure to pass through one tet, which cannot be cut by both."""
    return any(body.depth(other) < edges[i] / 4 for i, body in enumerate(bodies) for other in bodies[:i])


def own_volumes(bodies: Sequence[Solid]) -> Float64:
    """(R,) mm³ of each body without those inside it."""
    owner = _innermost_body(bodies)
    count = np.bincount(owner[bodies[0].mask], minlength=len(bodies))
    volumes: Float64 = count.astype(np.float64) * bodies[0].grid.voxel_volume
    return volumes


def _innermost_body(bodies: Sequence[Solid]) -> Int64:
    """(z, y, x) the innermost body at each voxel."""
    owner = np.zeros(bodies[0].mask.shape, dtype=np.int64)
    for number, body in enumerate(bodies):
        owner[body.mask] = number
    return owner


def divide_regions(
    bodies: Sequence[Solid], skin: Level, nodes: Float64, tets: Int64, edges: Sequence[float]
) -> tuple[Float64, Int64]:
    """Nodes (N, 3) mm, moved, and the body (M,) of each tet of a mesh of the first body, whose surface is `skin`.

    Volumes are those of the voxels as near as whole tets and moved nodes come. Raises `MeshError` if a body vanishes.
    """
    spacing = np.array(bodies[0].grid.spacing)
    owner, inside = _innermost_body(bodies), bodies[0].mask
    levels = [
        Level(inside & (owner == k), spacing, np.maximum(0.7 * spacing, 0.3 * edges[k])) for k in range(len(bodies))
    ]
    wanted = own_volumes(bodies)
    wanted /= wanted.sum()
    strewn = Shares(levels, np.zeros(len(bodies)))(_sample_points(inside, spacing))
    shares = Shares(levels, _bias(strewn, wanted, np.zeros(len(bodies))))
    owned = _cleaned(tets, signed_volumes(nodes, tets), _majority_region(shares, nodes, tets))
    gone = np.flatnonzero(np.bincount(owned, minlength=len(bodies)) == 0)
    if len(gone):
        raise MeshError(empty_body_message(bodies[gone[0]], edges[gone[0]]))
    aim, moved, best, off = wanted.copy(), nodes, nodes, np.inf
    moving = Moving(nodes, tets, owned, len(bodies), edges[0])
    for _ in range(5):
        moved = moving(shares, skin, moved)
        volume = signed_volumes(moved, tets)
        made = np.bincount(owned, weights=volume, minlength=len(bodies)) / volume.sum()
        error = float(np.abs(made / wanted - 1).max())
        if error < off:
            best, off = moved, error
        if off < 0.005:
            break
        aim = aim * np.clip(wanted / made, 0.8, 1.25)
        aim /= aim.sum()
        shares = Shares(levels, _bias(strewn, aim, shares.bias))
    return best, owned


def _sample_points(mask: Bool, spacing: Float64) -> Float64:
    """(S, 3) mm: points at an even distance in the voxels of a mask."""
    index = np.argwhere(mask)
    rng = np.random.default_rng(0)
    index = index[rng.integers(0, len(index), SAMPLES)]
    points: Float64 = (index + rng.uniform(-0.5, 0.5, index.shape))[:, ::-1] * spacing[::-1]
    return points


def _bias(shares: Float64, wanted: Float64, start: Float64) -> Float64:
    """(R,) to add to shares (S, R) so that region r is the largest at `wanted` r of the points; from `start` on."""
    bias = start.copy()
    step, limit = 0.2, 0.1
    for _ in range(25):
        made = np.bincount(np.argmax(shares + bias, axis=1), minlength=len(bias)) / len(shares)
        bias += np.clip(step * np.log(np.maximum(wanted, 1e-6) / np.maximum(made, 1e-6)), -limit, limit)
        bias -= bias.mean()
        step, limit = 0.93 * step, 0.85 * limit
    return bias


def _majority_region(shares: Shares, nodes: Float64, tets: Int64) -> Int64:
    """(M,) the region that fills most of each tet."""
    x = nodes[tets]
    total = np.zeros((len(tets), len(shares.levels)))
    for weights in INNER:
        total += np.clip(shares(np.einsum("j,mjk->mk", weights, x)), -1, 1)
    fills: Int64 = np.argmax(total, axis=1)
    return fills


def _cleaned(tets: Int64, volume: Float64, owned: Int64) -> Int64:
    """Tets that stick out with three faces go to the region around them; skins of regions become 2-manifolds."""
    owned = owned.copy()
    pairs = shared_faces(tets)[0]
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
            loose = here[~remove_pinches(tets[here], volume[here])] if len(here) else here
            votes[loose, region] = -1
            owned[loose] = np.argmax(votes[loose], axis=1)
    return owned


class Moving:
    """What repeated moves of a mesh's nodes need: its adjacency and its angles."""

    def __init__(self, nodes: Float64, tets: Int64, owned: Int64, regions: int, edge: float) -> None:
        self.nodes, self.tets, self.edge = nodes, tets, edge
        touches = np.zeros((len(nodes), regions), dtype=bool)
        touches[tets.ravel(), np.repeat(owned, 4)] = True
        outer = np.zeros(len(nodes), dtype=bool)
        outer[np.unique(boundary_faces(tets.astype(np.int32)))] = True
        self.between = np.flatnonzero(touches.sum(axis=1) > 1)
        self.touches, self.outer = touches[self.between], outer[self.between]
        pairs = edges_of(tets)
        ends = np.concatenate([pairs, pairs[:, ::-1]])
        near = np.zeros(len(nodes), dtype=bool)
        near[ends[np.isin(ends[:, 0], self.between), 1]] = True
        self.within = np.setdiff1d(np.flatnonzero(near & ~outer), self.between)
        # A node between regions is eased by neighbours that lie between the same ones; on the skin, by those on it.
        alike = ~(touches[ends[:, 0]] & ~touches[ends[:, 1]]).any(axis=1) & (~outer[ends[:, 0]] | outer[ends[:, 1]])
        self.eased_between = _mean_of_neighbours(len(nodes), ends[alike])
        self.eased_within = _mean_of_neighbours(len(nodes), ends)
        moves = np.zeros(len(nodes), dtype=bool)
        moves[self.between] = moves[self.within] = True
        self.near = np.flatnonzero(moves[tets].any(axis=1))
        self.bound = np.minimum(smallest_dihedral(nodes, tets[self.near]), LEAST) - 1e-9

    def __call__(self, shares: Shares, skin: Level, x: Float64) -> Float64:
        """(N, 3) mm: nodes between regions go to the boundary, those of the skin along it, their neighbours after them."""
        for attempt in range(ROUNDS):
            wish = x.copy()
            ease = 0.5 if attempt < ROUNDS // 2 else 0.15
            wish[self.between] += ease * (self.eased_between(x) - x)[self.between]
            wish[self.within] += 0.3 * (self.eased_within(x) - x)[self.within]
            wish[self.between] += _onto(shares, skin, wish[self.between], self.touches, self.outer, self.edge)
            step = wish - self.nodes
            far = np.linalg.norm(step, axis=1, keepdims=True) / (FURTHEST * self.edge)
            x = self._guarded(x, self.nodes + step / np.maximum(far, 1))
        return x

    def _guarded(self, x: Float64, wish: Float64) -> Float64:
        """As far towards `wish` as leaves every angle above its bound: steps of bad tets halve, then stop."""
        part = np.ones((len(x), 1))
        doubtful, bound, attempt = self.tets[self.near], self.bound, 0
        while True:
            there = x + part * (wish - x)
            bad = (smallest_dihedral(there, doubtful) < bound) | (signed_volumes(there, doubtful) <= 0)
            if not bad.any():
                return there
            nodes = np.zeros(len(x), dtype=bool)
            nodes[doubtful[bad]] = True
            part[nodes] *= 0.5 if attempt < 3 else 0
            attempt += 1
            again = nodes[self.tets[self.near]].any(axis=1)  # only what has changed since
            doubtful, bound = self.tets[self.near[again]], self.bound[again]


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
        off_skin = np.where(outer, skin(points), 0)[:, None]
        return np.concatenate([np.where(touches, share - mean, 0), off_skin], axis=1)

    here = values(x)
    slope = np.stack([(values(x + d) - values(x - d)) / (2 * reach) for d in reach * np.eye(3)], axis=2)
    step: Float64 = -np.einsum("nij,nj->ni", np.linalg.pinv(slope, rcond=0.15), here)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    limited: Float64 = step / np.maximum(length / (0.25 * edge), 1)
    return limited
