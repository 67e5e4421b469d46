"""Beam hardening by two materials: bone and calcifications take the soft part of a beam much faster than tissue does.

A curve for one material (`Spectrum`) leaves dark bands between bones. Here each ray has a curve of its own, by the share
of bone in its line integral, which a first reconstruction tells (the thought of Joseph & Spital, J. Comput. Assist.
Tomogr. 2:100, 1978; within a likelihood: Elbakri & Fessler, IEEE TMI 21:89, 2002).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import ArrayLike, Float32, Float64, float64
from palpate.bounded_read import read_text
from palpate.errors import DataError, FileError
from palpate.reconstruction.models.beam_hardening import REACH, STEPS, Hardened, Spectrum, Tabulated
from palpate.reconstruction.models.likelihood import Likelihood, Transmission
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import reconstruct
from palpate.scans.scan import Scan
from palpate.scans.views import Views
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

SHARES = 64  # intervals between the tabulated shares of bone
NEWTON = 30  # most steps; the curve is concave, so that they converge from the left


@dataclass(frozen=True, eq=False)
class TwoMaterials:
    """The beam-hardening curves of a spectrum behind soft tissue and bone.

    With the share s of bone in a line integral l, g = −log Σ w e^(−(soft (1 − s) + bone s) l). A voxel between the two
    attenuations is a mixture by volume, so that a bone that is blurred in depth keeps its line integrals.

    Parameters
    ----------
    weights : array_like, (energies,)
        As for `Spectrum`.
    soft, bone : array_like, (energies,)
        Attenuation of each material over its own at the reference energy, no unit.
    tissue : float
        Attenuation up to which a voxel is soft tissue, 1/mm.
    full : float
        Attenuation from which a voxel is bone, 1/mm.

    Raises
    ------
    DataError
        If a value is not valid, or `full` is not above `tissue`.

    Examples
    --------
    >>> materials = pp.TwoMaterials([1, 1], soft=[1.1, 0.9], bone=[1.4, 0.7], tissue=0.03, full=0.06)
    >>> materials.boned(np.float32([0.02, 0.06]))
    array([0.  , 0.06], dtype=float32)
    """

    weights: ArrayLike
    soft: ArrayLike
    bone: ArrayLike
    tissue: float
    full: float

    def __post_init__(self) -> None:
        for name in ("soft", "bone"):
            object.__setattr__(self, name, Spectrum(self.weights, getattr(self, name)).ratios)
        object.__setattr__(self, "weights", float64("spectrum weights", self.weights, (None,)))
        if not 0 <= self.tissue < self.full < float("inf"):
            raise DataError(
                f"two materials: expected the attenuation of soft tissue below that of bone, 1/mm, got {self.tissue!r} "
                f"and {self.full!r}"
            )

    def boned(self, values: Float32) -> Float32:
        """Return the part of each voxel's attenuation that bone contributes.

        Parameters
        ----------
        values : ndarray
            Attenuation, 1/mm, of any shape.

        Returns
        -------
        ndarray
            Attenuation of bone, 1/mm, of the same shape.
        """
        filled = np.clip((values - self.tissue) / (self.full - self.tissue), 0, 1)
        boned: Float32 = (filled * np.maximum(values, self.full)).astype(np.float32)
        return boned

    def shares(self, volume: Volume, views: Views) -> Float32:
        """Return the share of bone in each line integral.

        Parameters
        ----------
        volume : Volume
            Attenuation, 1/mm.
        views : Views
            The geometry.

        Returns
        -------
        ndarray, (views, rows, columns)
            Share from 0 to 1.
        """
        A = Projector(views, volume.grid)
        whole, bone = A(volume.values), A(self.boned(volume.values))
        share: Float32 = np.divide(bone, whole, out=np.zeros_like(bone), where=whole > 0)
        np.clip(share, 0, 1, out=share)
        return share

    def behind(self, share: ArrayLike) -> "Mixture":
        """Return the curve of each ray, for `Hardened` and `precorrected`.

        Parameters
        ----------
        share : array_like
            Share of bone, of any shape that broadcasts to that of the line integrals.

        Returns
        -------
        Mixture
            The curves.
        """
        return Mixture(self, np.asarray(share, np.float32))

    @cached_property
    def tables(self) -> tuple[Float64, Float64]:
        """g and g' for each tabulated share, (shares, l)."""
        soft, bone = np.asarray(self.soft), np.asarray(self.bone)
        mixed = (Tabulated(Spectrum(self.weights, soft + s * (bone - soft))) for s in np.linspace(0, 1, SHARES + 1))
        g, slope = zip(*(table.points for table in mixed), strict=True)
        return np.stack(g), np.stack(slope)


class Mixture:
    """A curve for each ray: between those of the two nearest tabulated shares, so value and slope are of one function."""

    def __init__(self, materials: TwoMaterials, share: Float32) -> None:
        if not ((share >= 0) & (share <= 1)).all():
            raise DataError(f"share of bone: expected 0 to 1, found {share.min():g} to {share.max():g}")
        self.g, self.slope = materials.tables
        self.low = np.minimum((share * SHARES).astype(np.int64), SHARES - 1)
        self.high_share = share * SHARES - self.low

    def __call__(self, l: ArrayLike) -> tuple[Float64, Float64, Float64]:
        """g, g', g'' at l >= 0 or a little below; straight beyond `REACH`."""
        l, step = np.asarray(l, np.float64), REACH / STEPS
        at = np.clip((l / step).astype(np.int64), 0, STEPS - 1)
        start, first, last = self._mixed(self.g, at), self._mixed(self.slope, at), self._mixed(self.slope, at + 1)
        whole, far = (last - first) / step, np.maximum(l - REACH, 0)
        rest = l - far - at * step
        bend = np.where((l >= 0) & (l < REACH), whole, 0)
        inner = np.where(l >= 0, whole, 0)
        return start + rest * (first + inner * rest / 2) + far * last, first + inner * rest, bend

    def inverse(self, p: ArrayLike) -> Float64:
        """l with g(l) = p, by Newton's steps."""
        p = np.asarray(p, np.float64)
        l: Float64 = p / self.steepest
        for _ in range(NEWTON):
            value, rise, _ = self(l)
            change = (p - value) / rise
            l = l + change
            if np.abs(change).max(initial=0) < 1e-9:
                break
        return l

    @property
    def steepest(self) -> Float64:
        """Largest g' of each ray."""
        return self._mixed(self.slope, 0)

    @property
    def sharpest(self) -> Float64:
        """No less than the largest −g'' of each ray."""
        most = -np.diff(self.slope, axis=1).min(axis=1, keepdims=True) * STEPS / REACH
        return self._mixed(most, 0)

    def _mixed(self, table: Float64, at: Any) -> Float64:
        index = self.low * table.shape[1] + at
        low, high = table.take(index), table.take(index + table.shape[1])
        mixed: Float64 = low + self.high_share * (high - low)
        return mixed


def two_material_beam_hardening_likelihood(
    materials: TwoMaterials, first: Volume, likelihood: Callable[[Scan], Likelihood] = Transmission.of
) -> Callable[[Scan], Likelihood]:
    """Return a likelihood for `reconstruct` that accounts for the bone in a first volume.

    Parameters
    ----------
    materials : TwoMaterials
        Spectrum and materials.
    first : Volume
        A reconstruction with the curve of soft tissue, or of the round before.
    likelihood : callable, optional
        From a scan to the likelihood of a monochromatic beam.

    Returns
    -------
    callable
        From a scan to a likelihood.

    Raises
    ------
    DataError
        When it is called, if the curve does not rise.

    Examples
    --------
    >>> materials = pp.TwoMaterials([1, 1], soft=[1.1, 0.9], bone=[1.4, 0.7], tissue=0.03, full=0.06)
    >>> likelihood = pp.two_material_beam_hardening_likelihood(materials, volume)
    >>> corrected = pp.reconstruct(scan, grid, likelihood=likelihood, levels=1, iterations=2)
    """
    return lambda scan: Hardened(likelihood(scan), materials.behind(materials.shares(first, scan.views)))


def two_material_beam_hardening(
    scan: Scan,
    grid: Grid,
    materials: TwoMaterials,
    rounds: int = 2,
    likelihood: Callable[[Scan], Likelihood] = Transmission.of,
    **options: Any,
) -> Volume:
    """Reconstruct a scan of soft tissue and bone, with correction of beam hardening.

    The first volume assumes soft tissue. Each round finds the bone in the volume before and reconstructs again, on the
    finest level.

    Parameters
    ----------
    scan : Scan
        The projections.
    grid : Grid
        The voxels.
    materials : TwoMaterials
        Spectrum and materials.
    rounds : int, optional
        Number of rounds after the first volume.
    likelihood : callable, optional
        From a scan to the likelihood of a monochromatic beam.
    **options
        As for `reconstruct`.

    Returns
    -------
    Volume
        Attenuation at the reference energy, 1/mm.

    Raises
    ------
    DataError, GeometryError
        As `reconstruct`.

    Examples
    --------
    >>> materials = pp.TwoMaterials([1, 1], soft=[1.1, 0.9], bone=[1.4, 0.7], tissue=0.03, full=0.06)
    >>> corrected = pp.two_material_beam_hardening(scan, grid, materials, rounds=1, levels=1, iterations=2)
    """
    if rounds < 1 or rounds != int(rounds):
        raise DataError(f"rounds: expected a whole number of at least 1, got {rounds!r}")
    soft = Spectrum(materials.weights, materials.soft)
    volume = reconstruct(scan, grid, likelihood=lambda s: Hardened(likelihood(s), soft), **options)
    for _ in range(rounds):
        more = {**options, "levels": 1, "start": volume}
        volume = reconstruct(
            scan, grid, likelihood=two_material_beam_hardening_likelihood(materials, volume, likelihood), **more
        )
    return volume


def read_spectrum(path: str | Path) -> Float64:
    r"""Read a spectrum from a text file.

    Each line holds the weight of an energy, the ratio of soft tissue and, for two materials, the ratio of bone, separated
    by commas. Text after # is a comment.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    ndarray, (energies, 2) or (energies, 3)
        Weights and ratios, no unit.

    Raises
    ------
    FileError
        If the file is missing or a line is wrong.

    Examples
    --------
    >>> _ = Path("tube.csv").write_text("1, 1.2  # 40 keV\n2, 0.9\n")
    >>> pp.read_spectrum("tube.csv")
    array([[1. , 1.2],
           [2. , 0.9]])
    """
    path = Path(path)
    try:
        lines = [line.split("#")[0].strip() for line in read_text(path).splitlines()]
        table = np.loadtxt([line for line in lines if line] or ["nothing"], delimiter=",", ndmin=2)
    except (OSError, ValueError) as problem:
        raise FileError(
            f"{path}: no spectrum could be read ({problem}); a line is weight,soft or weight,soft,bone"
        ) from None
    if table.shape[1] not in (2, 3):
        raise FileError(f"{path}: expected lines of weight,soft or weight,soft,bone, got {table.shape[1]} columns")
    return np.asarray(table, np.float64)
