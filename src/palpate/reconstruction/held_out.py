"""Held-out photons: whether a reconstruction predicts counts that it has not seen."""

from dataclasses import replace
from typing import Any

import numpy as np

from palpate.errors import DataError
from palpate.reconstruction.models.blurred import poisson
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import reconstruct
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid


def held_out_deviance(scan: Scan, grid: Grid, *, share: float = 0.5, seed: int = 0, **options: Any) -> float:
    """Return the deviance of photons that a reconstruction has not seen.

    Each photon is held out with a probability. Both parts are then independent Poisson counts of the same object. The
    volume of the one predicts the other; too weak a prior predicts noise, too strong a one misses the object. It compares
    strengths of **one** potential. Between potentials it misleads: it can prefer the one that loses faint detail, which
    weighs little in the sum. It lacks the held-out photons, so that the best strength is that of a lower dose.

    Parameters
    ----------
    scan : Scan
        The projections; counts of photons.
    grid : Grid
        The voxels.
    share : float, optional
        Probability that a photon is held out.
    seed : int, optional
        Of the draw; compare strengths with equal seeds.
    **options
        As for `reconstruct`.

    Returns
    -------
    float
        Deviance per measured pixel: about 1 if nothing but noise is left.

    Raises
    ------
    DataError
        If the counts are not whole numbers, `share` is not between 0 and 1, or an option is not valid.

    References
    ----------
    Neufeld, Dharamshi, Gao & Witten, Data thinning for convolution-closed distributions, J. Mach. Learn. Res. 25:57, 2024.

    Examples
    --------
    >>> weak, strong = (
    ...     pp.held_out_deviance(scan, grid, prior=pp.Prior("quadratic", strength), levels=1, iterations=5)
    ...     for strength in (0.1, 1e4)
    ... )
    >>> weak < strong
    True
    """
    if not 0 < share < 1:
        raise DataError(f"share: expected a probability between 0 and 1, got {share!r}")
    kept, held = split_photons(scan, share, seed)
    volume = reconstruct(kept, grid, **options)
    l = Projector(scan.views, grid)(volume.values)
    if held.blur is not None:
        held = replace(held, blur=held.blur.through(grid))
    return 2 * poisson(held).value(l) / max(int(np.count_nonzero(scan.mask)), 1)


def split_photons(scan: Scan, share: float, seed: int) -> tuple[Scan, Scan]:
    """The scan of the photons that are kept, and that of those held out. Raises `DataError`."""
    counts = np.where(scan.mask, scan.counts, 0).astype(np.float64)
    if (counts != np.round(counts)).any():
        raise DataError("counts: photons can be held out of whole numbers only; these are not counts of photons")
    held = np.random.default_rng(seed).binomial(counts.astype(np.int64), share)
    kept = 1 - share
    return (
        Scan(counts - held, kept * scan.incident, scan.views, kept * scan.background, scan.mask, blur=scan.blur),
        Scan(held, share * scan.incident, scan.views, share * scan.background, scan.mask, blur=scan.blur),
    )
