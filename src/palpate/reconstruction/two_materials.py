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
from numpy.typing import ArrayLike

from palpate.arrays import Float32, Float64, float64
from palpate.errors import DataError, FileError
from palpate.reconstruction.hardening import REACH, STEPS, Hardened, Spectrum, Tabulated
from palpate.reconstruction.likelihood import Likelihood, Transmission
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import reconstruct
from palpate.scans.scan import Scan
from palpate.scans.views import Views
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

SHARES = 64  # steps of bone's share between its curves
NEWTON = 30  # steps at most; the curve bends one way, so that from the left each comes nearer


@dataclass(frozen=True, eq=False)
class TwoMaterials:
    """A spectrum behind soft tissue and bone: g = −log Σ w e^(−(soft (1 − s) + bone s) l), s bone's share of l.

    weights: (energies,), as for `Spectrum`. soft, bone: (energies,), each material's attenuation over its own at the
    reference energy, no unit. tissue, full: attenuation at the reference energy, 1/mm, up to which a voxel is all soft
    tissue, and from which it is all bone; between the two it is a mixture by volume, so that a bone that is blurred over
    the depth keeps its line integrals. Raises `DataError`.
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
        """What of each voxel's attenuation is bone's, 1/mm; the shape of values."""
        filled = np.clip((values - self.tissue) / (self.full - self.tissue), 0, 1)
        boned: Float32 = (filled * np.maximum(values, self.full)).astype(np.float32)
        return boned

    def shares(self, volume: Volume, views: Views) -> Float32:
        """Bone's share of each ray's line integral, from 0 to 1 (views, rows, columns)."""
        A = Projector(views, volume.grid)
        whole, bone = A(volume.values), A(self.boned(volume.values))
        share: Float32 = np.divide(bone, whole, out=np.zeros_like(bone), where=whole > 0)
        np.clip(share, 0, 1, out=share)
        return share

    def behind(self, share: ArrayLike) -> "Mixture":
        """The curve of each ray, for `Hardened` and `precorrected`. share: of bone, any shape that broadcasts to l's."""
        return Mixture(self, np.asarray(share, np.float32))

    @cached_property
    def tables(self) -> tuple[Float64, Float64]:
        """g and g' (shares, l) of each tabulated share."""
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


def two_material_likelihood(
    materials: TwoMaterials, first: Volume, likelihood: Callable[[Scan], Likelihood] = Transmission.of
) -> Callable[[Scan], Likelihood]:
    """For `reconstruct(likelihood=)`: what the beam shows behind soft tissue and the bone that `first` has.

    first: a reconstruction with the curve of soft tissue alone, or of the round before.
    """
    return lambda scan: Hardened(likelihood(scan), materials.behind(materials.shares(first, scan.views)))


def two_material(
    scan: Scan,
    grid: Grid,
    materials: TwoMaterials,
    rounds: int = 2,
    likelihood: Callable[[Scan], Likelihood] = Transmission.of,
    **options: Any,
) -> Volume:
    """A reconstruction behind soft tissue alone, then `rounds` more, each with the bone that the one before found.

    Each goes on from the one before, on the finest level. options: of `reconstruct`. Raises `DataError`, `GeometryError`.
    """
    if rounds < 1 or rounds != int(rounds):
        raise DataError(f"rounds: expected a whole number of at least 1, got {rounds!r}")
    soft = Spectrum(materials.weights, materials.soft)
    volume = reconstruct(scan, grid, likelihood=lambda s: Hardened(likelihood(s), soft), **options)
    for _ in range(rounds):
        more = {**options, "levels": 1, "start": volume}
        volume = reconstruct(scan, grid, likelihood=two_material_likelihood(materials, volume, likelihood), **more)
    return volume


def read_spectrum(path: str | Path) -> Float64:
    """(energies, 2 or 3) of a text file: a line for each energy with weight, ratio of soft tissue and, for two materials,
    ratio of bone, with commas between; what follows # is a comment. Raises `FileError`.
    """
    path = Path(path)
    try:
        lines = [line.split("#")[0].strip() for line in path.read_text().splitlines()]
        table = np.loadtxt([line for line in lines if line] or ["nothing"], delimiter=",", ndmin=2)
    except (OSError, ValueError) as problem:
        raise FileError(
            f"{path}: no spectrum could be read ({problem}); a line is weight,soft or weight,soft,bone"
        ) from None
    if table.shape[1] not in (2, 3):
        raise FileError(f"{path}: expected lines of weight,soft or weight,soft,bone, got {table.shape[1]} columns")
    return np.asarray(table, np.float64)
