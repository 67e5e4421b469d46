"""Inertia: the lowest modes of vibration of a tissue."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import LinearOperator, eigsh

from palpate.arrays import Float64
from palpate.errors import MaterialError
from palpate.meshes.tet_mesh import TetMesh

if TYPE_CHECKING:
    from palpate.tissue.sparse_factor import Factors

TONNE = 1e-12  # N s²/mm⁴ in a kg/m³
MOST_MODES = 256


@dataclass(frozen=True)
class Inertia:
    """A tissue's mass, and how its swings die away.

    In sessions the body moves in its lowest modes of vibration. Those above follow their force with a lag.

    Parameters
    ----------
    damping : float, optional
        Damping ratio ζ of all modes, no unit, 0 ≤ ζ < 0.99.
    density : float, optional
        Mass per volume, kg/m³, 10 to 1e5.
    modes : int, optional
        Number of modes, 1 to 256; a small mesh may have fewer.
    lag : float, optional
        Time in which what is not in these modes follows its force, s, 0.0001 to 0.1.

    Raises
    ------
    MaterialError
        If a number is out of its range.

    References
    ----------
    Pentland & Williams, SIGGRAPH 1989, 215 (modes); Rubin, AIAA J. 13 (1975) 995 (residual flexibility).

    Examples
    --------
    >>> pp.Inertia(damping=0.05).density
    1060.0
    """

    damping: float = 0.05
    density: float = 1060.0
    modes: int = 100
    lag: float = 2e-3

    def __post_init__(self) -> None:
        if not 0 <= self.damping < 0.99:
            raise MaterialError(f"damping: {self.damping:g}; give a ratio from 0 to below 0.99, such as 0.05")
        if not 10 <= self.density <= 1e5:
            raise MaterialError(f"density: {self.density:g} kg/m³; tissue has about 1060, lung some 300")
        if self.modes not in range(1, MOST_MODES + 1):
            raise MaterialError(f"modes: {self.modes}; give 1 to {MOST_MODES}, such as 100")
        if not 1e-4 <= self.lag <= 0.1:
            raise MaterialError(f"lag: {self.lag:g} s; give 0.0001 to 0.1 s, such as 0.002")


def nodal_mass(mesh: TetMesh, density: float) -> Float64:
    """(N,) N s²/mm: a quarter of each tetrahedron's mass to each of its nodes. density: kg/m³."""
    share = mesh.volumes / 4 * density * TONNE
    return np.asarray(np.bincount(mesh.tets.ravel(), np.repeat(share, 4), minlength=len(mesh.nodes)), dtype=np.float64)


def lowest_modes(K: csr_array, mass: Float64, factors: "Factors", count: int) -> tuple[Float64, Float64]:
    """(modes,) ω in rad/s, ascending, and (n, modes) shapes φ with φᵀMφ = 1, of K φ = ω² M φ. K: (n, n). mass: (n,)."""
    most = min(count, K.shape[0] - 2)
    inverse = LinearOperator(K.shape, matvec=factors.solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(K.shape[0])
    square, shapes = eigsh(K, most, M=diags_array(mass).tocsc(), sigma=0, OPinv=inverse, v0=start)
    order = np.argsort(square)
    return np.sqrt(square[order]), np.asarray(shapes[:, order])
