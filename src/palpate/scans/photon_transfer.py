"""The gain of a panel from the noise of its flats: the photon transfer method."""

import numpy as np

from palpate.arrays import AnyArray, ArrayLike, Bool, Float64, float64
from palpate.errors import DataError
from palpate.scans.beam_profile import block_means

CONSTANT = 1e-4  # of the variance that a signal of photons has: below it, the frames are copies


def photon_transfer_gain(
    flats: ArrayLike,
    dark: ArrayLike = 0,
    electronic: float = 0.0,
    good: ArrayLike | None = None,
    pattern: ArrayLike = 1,
) -> float:
    """Estimate the gain, digital units for each photon, from repeated flats.

    A signal of N photons and the gain g has the mean g N and the variance g² N + σ², so g = (variance − σ²) / mean. Flats
    are scaled to one level first, since the tube's output varies. Light that spreads to neighbouring pixels lowers the
    variance of a pixel, and with it the gain that is found.

    Parameters
    ----------
    flats : array_like, (frames, rows, columns)
        Frames without object, at least two.
    dark : array_like, (rows, columns) or scalar, optional
        What a pixel reads without beam.
    electronic : float, optional
        Standard deviation σ of the read-out noise, digital units.
    good : array_like of bool, (rows, columns), optional
        Pixels to use.
    pattern : array_like, (rows, columns) or scalar, optional
        Gain of each pixel relative to the one that is asked for.

    Returns
    -------
    float
        Digital units for each photon: the median over blocks of the panel.

    Raises
    ------
    DataError
        If there is only one frame, or the frames have no noise.

    References
    ----------
    Janesick, Photon Transfer, SPIE Press, 2007.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> bool(abs(pp.photon_transfer_gain(2.5 * rng.poisson(900, (20, 64, 64))) - 2.5) < 0.05)
    True
    """
    frames = float64("flats", flats, (None, None, None)) - float64("dark", dark)
    if len(frames) < 2:
        raise DataError(f"gain: {len(frames)} flat tells no noise; give the gain, or a stack of at least 2 flats")
    used: Bool = np.ones(frames.shape[1:], bool) if good is None else np.asarray(good, bool)
    signal, variance = temporal_variance(frames, used)
    net = np.where(used & (signal > 0), variance - electronic**2, np.nan)
    wanted = np.where(used & (signal > 0), signal * float64("pattern", pattern), np.nan)
    side = max(used.shape) // 8
    ratios = block_means(net, side)[0] / block_means(wanted, side)[0]  # the median of a variance is not its mean
    ratios = ratios[np.isfinite(ratios)]
    found = float(np.median(ratios)) if ratios.size else 0.0
    if found <= 0 or float(np.nanmedian(variance)) <= CONSTANT * found:
        raise DataError(
            "gain: the flats do not vary from frame to frame, so they tell no noise; give the gain in digital units a photon"
        )
    return found


def temporal_variance(frames: Float64, good: AnyArray) -> tuple[Float64, Float64]:
    """Mean and variance over frames that are scaled to one level, (rows, columns) each."""
    levels = np.array([np.mean(frame[good]) for frame in frames])
    scaled = frames * (levels.mean() / levels)[:, None, None] if (levels > 0).all() else frames
    return scaled.mean(axis=0), scaled.var(axis=0, ddof=1)
