"""Says in numbers what the correction of a raw scan found."""

import numpy as np

from palpate.arrays import Float64, UInt8
from palpate.scans.bad_pixels import GOOD, KINDS
from palpate.scans.lag import Lag
from palpate.scans.scan import Scan


def tally(kinds: UInt8) -> str:
    """How many bad pixels there are of each kind, in words."""
    counts = np.bincount(kinds.ravel(), minlength=len(KINDS))
    return ", ".join(f"{n} {name}" for name, n in zip(KINDS[1:], counts[1:], strict=True) if n) or "none"


def correction_notes(
    scan: Scan,
    kinds: UInt8,
    units: Float64,
    sigma: float,
    noise: float,
    saturated: int,
    doses: Float64,
    lag: Lag,
    frames: int,
    by_view: bool,
) -> list[str]:
    """What was found, a line for each subject; noise: that of the flat, relative; frames: of the flat."""
    good = kinds == GOOD
    lines = [int((kinds.all(axis=axis)).sum()) for axis in (1, 0)]
    told = [
        f"bad pixels: {np.count_nonzero(~good)} of {good.size} ({np.mean(~good):.2%}): {tally(kinds)}; whole lines: "
        f"{lines[0]} rows, {lines[1]} columns",
        f"gain: {np.median(units[good]):.4g} digital units a photon, read-out noise {sigma:.3g} digital units",
        f"incident: {np.median(scan.incident[:, good]):.5g} photons; the flat leaves a noise of {noise:.2%} in it "
        + (f"({frames} frames, one a view)" if by_view else f"(mean of {frames} frame{'s' * (frames > 1)})"),
        f"dose: {doses.min():.3f} to {doses.max():.3f} of the flat's",
    ]
    share = lag.response(2)
    if lag.terms:
        told.append(
            f"lag: {share[1] / share[0]:.2%} of a frame's signal in the next, {1 - share[0]:.2%} in all later ones"
        )
    if saturated:
        told.append(f"saturated: {saturated} values ({saturated / scan.counts.size:.2%}) are masked")
    view_noise = float(np.median(1 / np.sqrt(np.maximum(scan.incident[:, good], 1))))
    if noise > 0.5 * view_noise:
        told.append(
            f"note: the flat's noise is the same in all views; {int(np.ceil(4 * frames * (noise / view_noise) ** 2))} frames "
            f"would halve it below that of a view in air"
        )
    return told
