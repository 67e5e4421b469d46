"""How a surface that crosses a tetrahedron of the lattice splits it in two parts, both made of tetrahedra.

Labelle & Shewchuk (2007) keep the inside only. Here both sides are kept, so that the boundary of an inclusion follows
element faces: the stencils of the outside are those of the inside with the sign reversed, and the face diagonals depend
on the face alone, so neighbours agree.
"""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Bool, Float64, Int64
from palpate.meshes.element_quality import smallest_dihedral
from palpate.meshes.stuffing.bcc_lattice import slant


@dataclass(frozen=True, eq=False)
class Pieces:
    """tets: (K, 4) nodes; side: (K,) 1 inside, -1 outside of the surface that cut; parent: (K,) lattice tet of each.

    points: (N, 3) all nodes, those that the stencils added last.
    """

    tets: Int64
    side: Int64
    parent: Int64
    points: Float64


@dataclass(frozen=True, eq=False)
class _Cut:
    """What the stencils ask: the lattice, the position of all nodes, and the node made on each cut edge.

    added: nodes that stencils made in the middle of prisms.
    """

    place: Int64
    points: Float64
    base: int
    keys: Int64
    first: int
    added: list[Float64]

    def middle(self, u: Int64, v: Int64) -> Int64:
        key = np.minimum(u, v) * self.base + np.maximum(u, v)
        found: Int64 = self.first + np.searchsorted(self.keys, key)
        return found

    def from_first(self, p: Int64, q: Int64, r: Int64) -> Bool:
        """Whether the quadrilateral p, q, cut(q, r), cut(p, r) is split by p - cut(q, r), else by q - cut(p, r).

        Short p-q: the diagonal leaves from the node whose cut edge is short. Long p-q: the parity rule of the paper, an
        even number of coordinates in which the diagonal's lattice node exceeds its other end.
        """
        P, Q, R = self.place[p], self.place[q], self.place[r]
        greater = (P > Q).sum(axis=1) + ((P == Q) & (P > R)).sum(axis=1)
        pq, pr, qr = (slant(self.place, np.stack(ends, axis=1)) for ends in ((p, q), (p, r), (q, r)))
        first: Bool = np.where(pq == 1, greater % 2 == 0, pr == 3)
        odd = np.flatnonzero((pq == 2) | (pr == 2) | (qr == 2))
        if len(odd):
            first[odd] = self._shorter_first(p[odd], q[odd], r[odd])
        return first

    def _shorter_first(self, p: Int64, q: Int64, r: Int64) -> Bool:
        """Where cells change size, faces are not the lattice's: the shorter diagonal."""
        x = self.points
        from_p = ((x[p] - x[self.middle(q, r)]) ** 2).sum(axis=1)
        from_q = ((x[q] - x[self.middle(p, r)]) ** 2).sum(axis=1)
        first: Bool = (from_p < from_q) | ((from_p == from_q) & (p < q))
        return first

    def add(self, corners: Int64) -> Int64:
        """New nodes in the middle of each row of nodes."""
        start = len(self.points) + sum(map(len, self.added))
        self.added.append(self.points[corners].mean(axis=1))
        return np.arange(start, start + len(corners))


def split(place: Int64, points: Float64, tets: Int64, sign: Int64, cuts: Int64, first: int) -> Pieces:
    """Splits `tets`, each cut by one surface for which its four nodes have `sign` (M, 4), along the `cuts` (C, 2).

    points: all nodes, those of the cuts in their order from index `first` on. Cuts are sorted, lower node first.
    """
    base = int(place.shape[0])
    cut = _Cut(place, points, base, cuts[:, 0] * base + cuts[:, 1], first, [])
    order = np.argsort(-sign, axis=1, kind="stable")
    nodes = np.take_along_axis(tets, order, axis=1)
    plus, minus = (sign > 0).sum(axis=1), (sign < 0).sum(axis=1)
    out: list[tuple[Int64, int, Int64]] = []
    for p, m, stencil in ((1, 1, _one_one), (1, 2, _one_two), (1, 3, _one_three), (2, 2, _two_two)):
        here = np.flatnonzero((plus == p) & (minus == m))
        if len(here):
            out += [(t, side, here[rows]) for t, side, rows in stencil(cut, nodes[here])]
        here = np.flatnonzero((plus == m) & (minus == p)) if p != m else here[:0]
        if len(here):
            out += [(t, -side, here[rows]) for t, side, rows in stencil(cut, nodes[here][:, ::-1])]
    if not out:
        return Pieces(np.zeros((0, 4), np.int64), np.zeros(0, np.int64), np.zeros(0, np.int64), points)
    return Pieces(
        np.concatenate([t for t, _, _ in out]),
        np.concatenate([np.full(len(t), side) for t, side, _ in out]),
        np.concatenate([here for _, _, here in out]),
        np.concatenate([points, *cut.added]),
    )


# Tets, their side of the surface, and the row of `nodes` that each is a piece of.
_Parts = list[tuple[Int64, int, Int64 | slice]]
_ALL = slice(None)


def _one_one(cut: _Cut, nodes: Int64) -> _Parts:
    a, y, z, b = nodes.T
    m = cut.middle(a, b)
    return [(np.stack([a, y, z, m], axis=1), 1, _ALL), (np.stack([m, y, z, b], axis=1), -1, _ALL)]


def _one_two(cut: _Cut, nodes: Int64) -> _Parts:
    a, z, b, c = nodes.T
    p, q = cut.middle(a, b), cut.middle(a, c)
    diagonal = cut.from_first(b, c, a)  # b - q, else c - p
    one = np.where(diagonal[:, None], np.stack([z, b, q, p], axis=1), np.stack([z, c, p, q], axis=1))
    two = np.where(diagonal[:, None], np.stack([z, b, c, q], axis=1), np.stack([z, b, c, p], axis=1))
    return [(np.stack([a, z, p, q], axis=1), 1, _ALL), (one, -1, _ALL), (two, -1, _ALL)]


def _one_three(cut: _Cut, nodes: Int64) -> _Parts:
    a = nodes[:, 0]
    top = nodes[:, 1:]
    bottom = np.stack([cut.middle(a, top[:, i]) for i in range(3)], axis=1)
    rises = [cut.from_first(top[:, i], top[:, j], a) for i, j in ((0, 1), (1, 2), (0, 2))]
    tets, ok = _prism(top, bottom, *rises)
    parts: _Parts = [(np.column_stack([a, bottom]), 1, _ALL)]
    parts += [(t[ok], -1, np.flatnonzero(ok)) for t in tets]
    rest = np.flatnonzero(~ok)
    if len(rest):
        t, b, (r01, r12, r02) = top[rest], bottom[rest], (r[rest] for r in rises)
        centre = cut.add(np.hstack([t, b]))
        parts += [(tet, -1, rest) for tet in _around(centre, t, b, r01, r02)]
        parts += [(tet, -1, rest) for tet in _fan(centre, t[:, 1:], b[:, 1:], r12)]
    return parts


def _two_two(cut: _Cut, nodes: Int64) -> _Parts:
    a, b, c, d = nodes.T
    ac, ad, bc, bd = cut.middle(a, c), cut.middle(a, d), cut.middle(b, c), cut.middle(b, d)
    sides = (
        (np.stack([a, ac, ad], 1), np.stack([b, bc, bd], 1), cut.from_first(a, b, c), cut.from_first(a, b, d)),
        (np.stack([c, ac, bc], 1), np.stack([d, ad, bd], 1), cut.from_first(c, d, a), cut.from_first(c, d, b)),
    )
    # The diagonal of the quadrilateral between the two parts: ac - bd or ad - bc; both parts must allow it.
    x = cut.points
    options, scores = [], []
    for choice in (True, False):
        made: list[Int64] = []
        score = np.full(len(a), np.inf)
        for top, bottom, first, second in sides:
            tets, ok = _prism(top, bottom, first, np.full(len(a), choice), second)
            made += tets
            score = np.minimum(score, np.where(ok, np.min([smallest_dihedral(x, t) for t in tets], axis=0), -1))
        options.append(made)
        scores.append(score)
    take = (scores[0] >= scores[1])[:, None]
    fits = np.maximum(*scores) >= 0
    rows, rest = np.flatnonzero(fits), np.flatnonzero(~fits)
    parts: _Parts = [
        (np.where(take, t, u)[rows], side, rows) for t, u, side in zip(*options, (1, 1, 1, -1, -1, -1), strict=True)
    ]
    if len(rest):  # four cuts, and the two parts want different diagonals: a node in the middle serves both
        centre = cut.add(np.stack([ac, ad, bc, bd], axis=1)[rest])
        for side, (top, bottom, first, second) in zip((1, -1), sides, strict=True):
            parts += [(t, side, rest) for t in _around(centre, top[rest], bottom[rest], first[rest], second[rest])]
    return parts


def _prism(top: Int64, bottom: Int64, r01: Bool, r12: Bool, r02: Bool) -> tuple[list[Int64], Bool]:
    """Three tets of a prism; r_ij: the diagonal of that side is top i - bottom j, else top j - bottom i.

    Also whether the diagonals allow it: not if they run round in a circle.
    """
    wins = np.stack([r01 * 1 + r02, ~r01 * 1 + r12, ~r02 * 1 + ~r12], axis=1)
    order = np.argsort(-wins, axis=1, kind="stable")
    t, b = np.take_along_axis(top, order, axis=1), np.take_along_axis(bottom, order, axis=1)
    tets = [
        np.column_stack([t, b[:, 2]]),
        np.column_stack([t[:, :2], b[:, 1:]]),
        np.column_stack([t[:, :1], b]),
    ]
    return tets, wins.max(axis=1) == 2


def _around(centre: Int64, top: Int64, bottom: Int64, r01: Bool, r02: Bool) -> list[Int64]:
    """Tets of a prism around a node inside it or on its side 1-2: from its ends and the sides 0-1 and 0-2."""
    ends = [np.column_stack([centre, face]) for face in (top, bottom)]
    return ends + [t for j, r in ((1, r01), (2, r02)) for t in _fan(centre, top[:, [0, j]], bottom[:, [0, j]], r)]


def _fan(centre: Int64, top: Int64, bottom: Int64, rises: Bool) -> list[Int64]:
    """The two tets between a node and a quadrilateral, split from top 0 to bottom 1, else from top 1 to bottom 0."""
    square = np.column_stack([top, bottom[:, ::-1]])
    square = np.where(rises[:, None], square, square[:, [1, 2, 3, 0]])
    return [np.column_stack([centre, square[:, [0, i, i + 1]]]) for i in (1, 2)]
