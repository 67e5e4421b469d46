"""Smoothed linear tetrahedra: strain averaged over edges and dilatation over nodes, with the unknowns of P1."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.sparse import bsr_array

from palpate import _core
from palpate.arrays import Float64, Int32

EDGES = np.array([(a, b) for a in range(4) for b in range(a + 1, 4)])


class Solid(Protocol):
    """What a stiffness needs of a mesh."""

    @property
    def nodes(self) -> Float64: ...  # noqa: D102
    @property
    def tets(self) -> Int32: ...  # noqa: D102
    @property
    def region(self) -> Int32: ...  # noqa: D102
    @property
    def filled(self) -> Float64 | float: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class SmoothingCells:
    """Where strain is averaged. A cell belongs to an edge or a node and to one region, so that no average crosses a
    material's boundary. A tetrahedron gives a sixth of its volume to each of its edges' cells, a quarter to its nodes'.

    volumes: (M,) mm³ of the tetrahedra. slopes: (M, 4, 3) 1/mm, gradients of their corners' shape functions. edge: (M,
    6) and node: (M, 4) number of the cell that each edge (01 02 03 12 13 23) and corner of a tetrahedron belongs to.
    edge_volumes, node_volumes: mm³. mu: N/mm² of the edges' cells, the mean of their parts. lam: N/mm² of the nodes'
    cells, the harmonic mean: the pressures of the parts are equal, so their dilatations add up.
    """

    volumes: Float64
    slopes: Float64
    edge: Int32
    node: Int32
    edge_volumes: Float64
    node_volumes: Float64
    mu: Float64
    lam: Float64


def smoothing_cells(mesh: Solid, lam: Float64, mu: Float64) -> SmoothingCells:
    """Return the smoothing cells of a mesh.

    Parameters
    ----------
    mesh : Solid
        A mesh, with its regions.
    lam, mu : ndarray, (M,)
        Lamé's constants of the tetrahedra, N/mm².

    Returns
    -------
    SmoothingCells
        The cells, their volumes and constants.

    References
    ----------
    Bonet & Burton, Commun. Numer. Methods Eng. 14 (1998) 437: dilatation averaged over nodes.
    Liu & Nguyen-Thoi, Smoothed Finite Element Methods, CRC Press, 2010: strain averaged over edges.
    """
    volumes, slopes = _shapes(mesh)
    tets = mesh.tets.astype(np.int64)
    count = len(mesh.nodes)
    region = np.unique(mesh.region, return_inverse=True)[1].astype(np.int64)[:, None]
    ends = np.sort(tets[:, EDGES], axis=2)
    edge = _numbered((region * count + ends[:, :, 0]) * count + ends[:, :, 1])
    node = _numbered(region * count + tets)
    edge_volumes = np.bincount(edge.ravel(), np.repeat(volumes / 6, 6)).astype(np.float64)
    node_volumes = np.bincount(node.ravel(), np.repeat(volumes / 4, 4)).astype(np.float64)
    with np.errstate(divide="ignore"):  # ν = 0 has λ = 0, and so has the mean
        softness = np.bincount(node.ravel(), np.repeat(volumes / 4 / lam, 4))
    mean = np.bincount(edge.ravel(), np.repeat(volumes / 6 * mu, 6)) / edge_volumes
    return SmoothingCells(volumes, slopes, edge, node, edge_volumes, node_volumes, mean, node_volumes / softness)


def edge_stiffening(cells: SmoothingCells, mu: Float64, stiffening: Float64) -> Float64:
    """(cells,) exponent of each edge's cell: the mean of its parts with the weights of their shear moduli."""
    weight = np.repeat(cells.volumes / 6 * mu, 6)
    whole = np.bincount(cells.edge.ravel(), weight * np.repeat(stiffening, 6))
    return np.asarray(whole / np.bincount(cells.edge.ravel(), weight))


def smoothed_stiffness(mesh: Solid, lam: Float64, mu: Float64) -> bsr_array:
    """Return the stiffness of linear elasticity on smoothed tetrahedra.

    K = Σ V_g 2 μ_g ε̄_gᵀε̄_g over the edges' cells + Σ V_a λ_a d̄_a d̄_aᵀ over the nodes' cells, with ε̄ and d̄ the means of
    strain and dilatation in a cell. With μ and λ on the cells, and not the deviator and the bulk modulus, the split is
    that of the neo-Hookean energy.

    Parameters
    ----------
    mesh : Solid
        A mesh.
    lam, mu : ndarray, (M,)
        Lamé's constants of the tetrahedra, N/mm².

    Returns
    -------
    bsr_array, (3N, 3N)
        In 3×3 blocks, N/mm; symmetric to the bit. It has 4 to 5 times the entries of that of P1.

    References
    ----------
    Bonet & Burton, Commun. Numer. Methods Eng. 14 (1998) 437.
    Liu & Nguyen-Thoi, Smoothed Finite Element Methods, CRC Press, 2010.
    """
    return _stiffness(mesh, lam, mu, smoothed=True)


def p1_stiffness(mesh: Solid, lam: Float64, mu: Float64) -> bsr_array:
    """Return the stiffness of linear elasticity on P1 tetrahedra, each of which is a cell of its own.

    Parameters
    ----------
    mesh : Solid
        A mesh.
    lam, mu : ndarray, (M,)
        Lamé's constants of the tetrahedra, N/mm².

    Returns
    -------
    bsr_array, (3N, 3N)
        In 3×3 blocks, N/mm; symmetric to the bit.
    """
    return _stiffness(mesh, lam, mu, smoothed=False)


def _stiffness(mesh: Solid, lam: Float64, mu: Float64, smoothed: bool) -> bsr_array:
    filled = np.array(np.broadcast_to(mesh.filled, len(mesh.tets)), dtype=np.float64)
    start, column, block = _core.elements.stiffness(mesh.nodes, mesh.tets, mesh.region, filled, lam, mu, smoothed)
    size = 3 * len(mesh.nodes)
    return bsr_array((block, column, start), shape=(size, size))


def _shapes(mesh: Solid) -> tuple[Float64, Float64]:
    """(M,) mm³ of what fills each tet, and (M, 4, 3) 1/mm gradients of its corners' shape functions."""
    x = mesh.nodes[mesh.tets]
    sides = x[:, 1:] - x[:, :1]
    slopes = np.empty((len(x), 4, 3))
    slopes[:, 1:] = np.linalg.inv(sides).swapaxes(1, 2)
    slopes[:, 0] = -slopes[:, 1:].sum(axis=1)
    return np.linalg.det(sides) / 6 * mesh.filled, slopes


def _numbered(key: Any) -> Int32:
    """The keys' numbers from 0, in their order."""
    number: Int32 = np.unique(key, return_inverse=True)[1].reshape(key.shape).astype(np.int32)
    return number
