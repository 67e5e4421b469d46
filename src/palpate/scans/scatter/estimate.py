"""The scatter of a scan: kernels superposed by thickness on the estimated primary."""

from collections.abc import Sequence

import numpy as np
from scipy import fft, ndimage

from palpate.arrays import ArrayLike, Bool, Float32, Float64, float64
from palpate.errors import DataError
from palpate.scans.scan import Scan
from palpate.scans.scatter.kernels import REACH, ScatterKernels
from palpate.scans.views import Panel

ROUNDS = 5
TINY = 1e-6  # photons
CELL = 2.5  # mm; scatter is smooth over several
THICKEST = 0.98  # quantile of the thickness that stands for the thickest


def estimate_scatter(
    scan: Scan,
    kernels: ScatterKernels,
    air_gap: float = 15.0,
    thickness: float | ArrayLike | None = None,
    beyond: float = REACH,
    rounds: int = ROUNDS,
) -> Float32:
    """Estimate the expected scatter of a scan, by kernels of slabs on the estimated primary.

    In each round the primary is what was counted less its share of scatter, the thickness follows from the primary, and
    every pixel scatters as a slab of its thickness: S = Σ primary · K(thickness, distance). Oblique rays go through more
    tissue and a longer gap, and their kernels are drawn out on the panel. The amplitude is the table's: the counts cannot
    give it.

    Parameters
    ----------
    scan : Scan
        The projections. Their `background` is what they have beside scatter.
    kernels : ScatterKernels
        Of the beam, see `scatter_kernels`.
    air_gap : float, optional
        From the object down to the panel, mm.
    thickness : float or array_like, (views, rows, columns), optional
        Of the object at its thickest, as the compression plate tells it, mm; or of the tissue along each ray. By default it
        is that of the table's tissue, half adipose, which takes dense tissue for thicker than it is.
    beyond : float, optional
        How far object and beam go on beyond the panel's edges, mm, as at the chest wall; there the values of the edge are
        repeated. 0 for a beam and an object that end with the panel.
    rounds : int, optional
        How often primary and scatter are estimated in turn.

    Returns
    -------
    ndarray, (views, rows, columns)
        The scan's background with the scatter, photons, none below 0: give it to `Scan` as `background`.

    Raises
    ------
    DataError
        If an argument is not valid.

    References
    ----------
    Ohnesorge, Flohr & Klingenbeck-Regn, Eur. Radiol. 9:563, 1999. Sun & Star-Lack, Phys. Med. Biol. 55:6695, 2010.

    Examples
    --------
    >>> background = pp.estimate_scatter(scan, pp.scatter_kernels(kv=30))
    >>> background.shape == scan.shape
    True
    """
    if not 0 <= air_gap <= 500:
        raise DataError(f"air_gap: expected 0 to 500 mm from the object to the panel, got {air_gap!r}")
    if not beyond >= 0:
        raise DataError(f"beyond: expected 0 mm or more, got {beyond!r}")
    if rounds < 1 or int(rounds) != rounds:
        raise DataError(f"rounds: expected a whole number of at least 1, got {rounds!r}")
    most, given = None, None
    if isinstance(thickness, int | float):
        most = float(thickness)
        if not 1 <= most <= 500:
            raise DataError(f"thickness: expected 1 to 500 mm, got {thickness!r}")
    elif thickness is not None:
        given = float64("thickness", thickness, scan.shape)
    found = np.empty(scan.shape, np.float32)
    for view, (source, panel) in enumerate(zip(scan.views.source, scan.views.panels, strict=True)):
        cells = _Cells(panel, source)
        net = np.maximum(scan.counts[view].astype(np.float64) - scan.background[view], 0)
        measured = scan.mask[view]
        counts = cells.mean(net, measured)
        incident = cells.mean(scan.incident[view].astype(np.float64), measured)
        known = most if given is None else cells.mean(given[view], measured)
        scatter = _scatter_of_view(counts, incident, known, kernels, air_gap, beyond, cells, rounds)
        found[view] = scan.background[view] + np.maximum(cells.refined(scatter), 0)
    return found


class _Cells:
    """Blocks of pixels of a panel, about `CELL` mm wide, and how the rays of a source meet it."""

    def __init__(self, panel: Panel, source: Float64) -> None:
        self.shape = panel.shape
        self.block = [
            min(max(1, round(CELL / pitch)), count) for pitch, count in zip(panel.pitch, panel.shape, strict=True)
        ]
        self.pitch = [pitch * n for pitch, n in zip(panel.pitch, self.block, strict=True)]
        middle = panel.points([(np.array(panel.shape) - 1) / 2])[0]
        ray = middle - source
        self.cosine = abs(float(ray @ panel.normal)) / float(np.linalg.norm(ray))
        self.tangent = float(np.sqrt(max(1 / self.cosine**2 - 1, 0)))
        lean = np.array([ray @ panel.row_axis, ray @ panel.column_axis])
        length = float(np.linalg.norm(lean))
        self.lean = lean / length if length > 0 else np.array([1.0, 0.0])  # towards which rays lean, (row, column)

    def mean(self, values: Float64, measured: Bool) -> Float64:
        """Mean over the measured pixels of each block; a block without any takes the nearest."""
        total, count = (self._sums(a) for a in (np.where(measured, values, 0), measured.astype(np.float64)))
        found = total / np.maximum(count, 1)
        if (count == 0).any():
            nearest = ndimage.distance_transform_edt(count == 0, return_distances=False, return_indices=True)
            found = found[tuple(nearest)]
        return found

    def _sums(self, values: Float64) -> Float64:
        rows, columns = (np.arange(0, n, b) for n, b in zip(self.shape, self.block, strict=True))
        return np.asarray(np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1))

    def refined(self, cells: Float64) -> Float64:
        """Back to pixels, linear between the middles of blocks."""
        for axis, (n, block) in enumerate(zip(self.shape, self.block, strict=True)):
            first = np.arange(0, n, block)
            middles = (first + np.minimum(first + block, n) - 1) / 2
            at = np.interp(np.arange(n), middles, np.arange(len(middles)))
            low = np.minimum(at.astype(int), max(len(middles) - 2, 0))
            high = np.minimum(low + 1, len(middles) - 1)
            part = np.expand_dims(at - low, 1 - axis)
            cells = (1 - part) * np.take(cells, low, axis) + part * np.take(cells, high, axis)
        return cells


def _scatter_of_view(
    counts: Float64,
    incident: Float64,
    known: float | Float64 | None,
    kernels: ScatterKernels,
    air_gap: float,
    beyond: float,
    cells: _Cells,
    rounds: int,
) -> Float64:
    """Expected scatter of each cell, photons a pixel."""
    margin = [int(np.ceil(min(beyond, REACH) / pitch)) for pitch in cells.pitch]
    size = [n + 2 * m for n, m in zip(counts.shape, margin, strict=True)]
    reach = [
        fft.next_fast_len(n + int(np.ceil(REACH / cells.cosine / p)), real=True)
        for n, p in zip(size, cells.pitch, strict=True)
    ]
    depth = -np.log(kernels.transmission)
    primary, scatter = counts, np.zeros_like(counts)
    for _ in range(rounds):
        share = np.clip(primary / np.maximum(incident, TINY), np.exp(-depth[-1]), 1)
        thickness = np.interp(-np.log(share), depth, kernels.thickness)
        most = float(np.quantile(thickness, THICKEST))
        if isinstance(known, np.ndarray):
            thickness, most = known, float(np.quantile(known, THICKEST))
        elif known is not None and most > 0:
            thickness, most = thickness * (known / cells.cosine / most), known / cells.cosine
        # Round edges: the middle of a thin part is as high as that of the thickest.
        gaps = air_gap / cells.cosine + np.maximum(most - kernels.thickness, 0) / 2
        responses = [
            fft.rfft2(_on_cells(*kernels.kernel(k, gaps[k], cells.tangent), kernels.radius, cells, reach))
            / kernels.transmission[k]
            for k in range(1, len(kernels.thickness))
        ]
        at = np.interp(thickness, kernels.thickness, np.arange(len(kernels.thickness)))
        at, sent = (np.pad(a, [(m, m) for m in margin], mode="edge") for a in (at, incident * share))
        spectrum = np.zeros((reach[0], reach[1] // 2 + 1), np.complex128)
        for k, response in enumerate(responses, 1):
            spectrum += fft.rfft2(sent * np.maximum(1 - np.abs(at - k), 0), reach) * response
        whole = fft.irfft2(spectrum, reach)
        scatter = np.maximum(whole[margin[0] :, margin[1] :][: counts.shape[0], : counts.shape[1]], 0)
        # What is counted, times the primary's share in the last estimate: it stays above 0, and converges for scatter
        # above the primary, where subtraction would swing.
        primary = counts * primary / np.maximum(primary + scatter, TINY)
    return scatter


def _on_cells(energy: Float64, shift: float, radius: Float64, cells: _Cells, size: Sequence[int]) -> Float64:
    """The kernel on the panel's cells, periodic, its pencil at (0, 0): energy of rings over their areas, moved against the
    lean of the rays, and drawn out along it so that the energy stays."""
    density = energy / (np.pi * np.diff(radius**2))
    middles = np.sqrt((radius[1:] ** 2 + radius[:-1] ** 2) / 2)
    y, x = (fft.fftfreq(n, 1 / (n * p)) for n, p in zip(size, cells.pitch, strict=True))
    along = y[:, None] * cells.lean[0] + x * cells.lean[1] + shift
    across = y[:, None] * cells.lean[1] - x * cells.lean[0]
    r = np.hypot(along * cells.cosine, across)
    found = np.interp(r, middles, density) * (r < REACH) * cells.pitch[0] * cells.pitch[1] * cells.cosine
    middle = np.unravel_index(np.argmin(r), r.shape)
    found[middle] = 0
    whole = float(np.interp(REACH, radius, np.concatenate([[0], np.cumsum(energy)])))
    found[middle] = max(whole - found.sum(), 0)  # the steep middle, by its energy
    return np.asarray(found * (whole / max(found.sum(), TINY)))
