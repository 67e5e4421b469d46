"""From what a panel reads to counts of photons: dark, flat, bad pixels, gain, lag, dose of each view."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import AnyArray, ArrayLike, Float32, Float64, UInt8, float32
from palpate.errors import DataError
from palpate.scans import flat_check
from palpate.scans.bad_pixels import CHANGED, GOOD, changed_in_views, find_bad_pixels
from palpate.scans.beam_profile import BeamProfile, fit_beam_profile, most_level_view
from palpate.scans.blur import Blur
from palpate.scans.correction_notes import correction_notes, tally
from palpate.scans.detector_model import integrating_scan
from palpate.scans.intensity_correction import open_beam
from palpate.scans.lag import Lag, deconvolve_lag
from palpate.scans.photon_transfer import photon_transfer_gain
from palpate.scans.scan import Scan
from palpate.scans.views import Views

AIR = "air"  # a dose of each view from its own brightest level


@dataclass(frozen=True, eq=False)
class Correction:
    """A scan made of raw read-outs, and what was found on the way.

    Parameters
    ----------
    scan : Scan
        Counts in photons, `incident` of each pixel and view, read-out noise as background, bad pixels masked.
    gain : ndarray, (rows, columns)
        Digital units for each photon.
    kinds : ndarray of uint8, (rows, columns)
        0 for good pixels, else the position in `scans.bad_pixels.KINDS`.
    dose : ndarray, (views,)
        Exposure of each view relative to the flat.
    lag : Lag
        The lag that was removed.
    electronic : float
        Standard deviation of the read-out noise, digital units.
    flat_noise : float
        Standard deviation of `incident`, relative, that the flat's own photons leave.
    saturated : int
        Values of the views that were masked since the read-out was clipped.
    notes : tuple of str
        What was found and assumed, in words.

    Examples
    --------
    >>> flat = np.full((40, 48), 2100.0)
    >>> done = pp.correct_scan(2 * scan.counts + 100, views, dark=100, flat=20_100, gain=2.0)
    >>> bool(np.allclose(done.scan.counts, scan.counts, rtol=1e-3))
    True
    """

    scan: Scan
    gain: Float32
    kinds: UInt8
    dose: Float64
    lag: Lag
    electronic: float
    flat_noise: float
    saturated: int
    notes: tuple[str, ...]


def correct_scan(
    raw: ArrayLike,
    views: Views,
    dark: ArrayLike,
    flat: ArrayLike,
    *,
    gain: ArrayLike | None = None,
    lag: Lag | float | None = None,
    dose: ArrayLike | str | None = None,
    offset: ArrayLike | None = None,
    electronic: float | None = None,
    bad_pixels: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    dark_by_view: bool = False,
    flat_by_view: bool = False,
    flat_view: int | None = None,
    check: bool = True,
    blur: Blur | None = None,
) -> Correction:
    """Make a scan of what a panel read: counts in photons, and the photons of the beam in every pixel and view.

    A pixel i reads in view k, before lag, dark + offset_k + gain_i · photons. Counts are divided by the gain alone, which
    is fine structure of the flat; heel effect, inverse square law and dose stay in `incident`, so the counts remain Poisson.

    Parameters
    ----------
    raw : array_like, (views, rows, columns)
        Read-outs in digital units, in the order of time.
    views : Views
        The geometry.
    dark, flat : array_like
        Frames without beam, and with the beam and no object: a scalar, (rows, columns) or (frames, rows, columns). A
        scalar flat is that of every view.
    gain : array_like, optional
        Digital units for each photon: a scalar, its mean over the panel, or (rows, columns). The default is the photon
        transfer method, for which the flat needs two frames.
    lag : Lag or float, optional
        Lag of the panel; a number is that of `Lag.first_order`. Stacks are taken to begin with the panel at rest, and a
        flat of one frame to be the mean of a beam that stayed on.
    dose : array_like, (views,), or "air", optional
        Exposure of each view relative to the flat, as a dosimeter at the tube reads it. "air" takes the brightest level of
        each view for air. The default is that of the flat.
    offset : array_like, optional
        Digital units that a view reads above the dark, a scalar or (views,).
    electronic : float, optional
        Standard deviation of the read-out noise, digital units. The default is that of the dark's frames.
    bad_pixels : array_like of bool, (rows, columns), optional
        True at pixels that are known to be bad. Others are found.
    mask : array_like of bool, optional
        True where measured, as in `Scan`.
    dark_by_view, flat_by_view : bool, optional
        Take each frame for the view of the same number, and no mean of them.
    flat_view : int, optional
        The view that has the tube where it was for the flat. The default is the view that looks straightest on the
        panel. Another place of the tube changes the beam by the inverse square law, the obliquity and the heel effect.
    check : bool, optional
        Refuse a flat that does not fit the views: an object in it, another panel, the beam of another geometry.
    blur : Blur, optional
        Of panel and focal spot. It stays in the counts; the scan carries it.

    Returns
    -------
    Correction
        The scan and what was found.

    Raises
    ------
    DataError
        If dark or flat cannot be right; the message names which, where, and what to do.

    References
    ----------
    Seibert, Boone and Lindfors, Proc. SPIE 3336:348, 1998 (flat field); Hsieh et al., Proc. SPIE 3977:298, 2000 (lag);
    Janesick, Photon Transfer, 2007 (gain); ASTM E2597 (bad pixels).

    Examples
    --------
    >>> done = pp.correct_scan(2 * scan.counts + 100, views, dark=100, flat=20_100, gain=2.0)
    >>> done.scan.incident.mean().round()
    np.float32(10000.0)
    """
    shape = (views.shape[1], views.shape[2])
    raw = _raw(raw, views.shape, mask)
    measured = np.isfinite(raw) if mask is None else np.broadcast_to(np.asarray(mask, bool), views.shape)
    darks = _frames("dark", dark, shape, len(views) if dark_by_view else None)
    flats = _frames("flat", flat, shape, len(views) if flat_by_view else None)
    response = lag if isinstance(lag, Lag) else Lag.first_order(0.0 if lag is None else lag)
    doses = _doses(dose, len(views))
    flat_check.check_exposure(darks, flats, raw[measured])
    for name, frames, by_view in (("dark", darks, dark_by_view), ("flat", flats, flat_by_view)):
        if not by_view and check:
            flat_check.check_repeats(name, frames, darks[:1] * 0 if name == "dark" else darks)
    notes: list[str] = []

    offsets = darks if dark_by_view else darks.mean(axis=0, dtype=np.float64)[None]
    still = _by_view("offset", 0 if offset is None else offset, len(views))[:, None, None]
    # A flat of one frame is the mean of many, in which lag has settled.
    beams = float32("flat", flats - (offsets if flat_by_view and dark_by_view else offsets.mean(axis=0)))
    beams = deconvolve_lag(beams, response) if len(beams) > 1 else beams
    signal = beams.mean(axis=0, dtype=np.float64)
    repeats = signal[None] if flat_by_view else beams
    kinds = find_bad_pixels(darks, repeats + darks.mean(axis=0), bad_pixels)
    if (kinds == GOOD).mean() < 0.5:
        raise DataError(
            f"flat: {(kinds != GOOD).mean():.0%} of the pixels do not respond as their neighbours do ({tally(kinds)}); "
            f"check dark and flat, or mask what a collimator hides with bad_pixels"
        )

    place = most_level_view(views) if flat_view is None else _view(flat_view, len(views))
    places = range(len(views)) if flat_by_view else [place]
    profiles = [
        fit_beam_profile(beam, kinds == GOOD, views.source[k], views.panels[k])
        for beam, k in zip(beams if flat_by_view else signal[None], places, strict=True)
    ]
    smooth = [profile.on(views.source[k], views.panels[k]) for profile, k in zip(profiles, places, strict=True)]
    pattern = np.mean([b / s for b, s in zip(beams if flat_by_view else signal[None], smooth, strict=True)], axis=0)
    pattern /= np.median(pattern[kinds == GOOD])
    if check:
        flat_check.check_no_object(pattern, kinds)

    sigma = _electronic(electronic, darks, kinds) * _amplification(response, len(views))
    sigma = sigma if sigma > 1e-6 * np.median(signal) else 0.0  # rounding of frames without noise
    units = _gain(gain, beams, sigma, kinds, pattern, flat_by_view)
    y = raw - np.float32(offsets if dark_by_view else offsets[0]) - still.astype(np.float32)
    y = deconvolve_lag(np.where(measured, y, 0), response)
    y /= units.astype(np.float32)

    beam = _beam(signal, beams, profiles, views, place, flat_by_view or np.ndim(flat) == 0, notes) / units
    noise = float(np.median(1 / np.sqrt(np.maximum(signal / units, 1e-12)[kinds == GOOD])))
    noise /= np.sqrt(1 if flat_by_view else len(flats))
    bad = kinds != GOOD
    if isinstance(doses, str):
        good = measured & ~bad
        level = float(np.median(beam[..., ~bad]))
        doses = open_beam(np.where(good, np.maximum(y, 0) * (level / np.maximum(beam, 1e-12)), 0), good) / level
    beam = (beam * np.asarray(doses)[:, None, None]).astype(np.float32)
    beam[:, bad] = np.median(beam[:, ~bad], axis=1)[:, None]  # masked, but a picture of it should not be wild
    if check:
        flat_check.check_same_panel(pattern, y * units.astype(np.float32), kinds, noise)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(bad, 0, y / beam)
        top = float(np.quantile(ratio[:, ~bad][:, :: max(1, np.count_nonzero(~bad) // 100_000)], 0.99))
        if top > flat_check.BRIGHTER:
            raise DataError(
                f"flat: the views are up to {top:.2f} times as bright, and nothing is brighter than air; give the dose of "
                f"each view relative to the flat, or a flat with the exposure of the views"
            )
        flat_check.check_beam_side(ratio, kinds)
    full = flat_check.clipped(raw[:, ~bad])
    valid = measured & ~bad
    if full is not None:
        valid[:, ~bad] &= ~full
    kinds = kinds.copy()
    kinds[changed_in_views(y, beam, kinds)] = CHANGED
    valid &= kinds == GOOD
    if not valid.any():
        raise DataError("raw: no pixel is left that measures; check dark, flat and bad_pixels")
    saturated = 0 if full is None else int(full.sum())
    scan = replace(integrating_scan(y, beam, views, 0, valid, electronic=sigma / units), blur=blur)
    notes = [
        *correction_notes(
            scan, kinds, units, sigma, noise, saturated, np.asarray(doses), response, len(flats), flat_by_view
        ),
        *notes,
    ]
    return Correction(
        scan,
        units.astype(np.float32),
        kinds,
        np.asarray(doses, np.float64),
        response,
        sigma,
        noise,
        saturated,
        tuple(notes),
    )


def _raw(raw: ArrayLike, shape: tuple[int, int, int], mask: ArrayLike | None) -> Float32:
    values = np.asarray(raw)
    if values.shape != shape:
        raise DataError(f"raw: expected (views, rows, columns) = {shape} as in the geometry, got {values.shape}")
    if mask is not None:
        values = np.where(np.broadcast_to(np.asarray(mask, bool), shape), values, 0)
    flat_check.checked_frames("raw", values, shape[1:])
    return float32("raw", values)


def _frames(name: str, values: ArrayLike, shape: tuple[int, int], views: int | None) -> AnyArray:
    frames = flat_check.checked_frames(name, values, shape)
    if views is not None and len(frames) != views:
        raise DataError(f"{name}: {len(frames)} frames, but one for each of {views} views was said; give as many")
    return frames


def _view(view: int, count: int) -> int:
    if not 0 <= view < count:
        raise DataError(f"flat_view: {view} is not there; the scan has views 0 to {count - 1}")
    return view


def _doses(dose: ArrayLike | str | None, count: int) -> Float64 | str:
    if isinstance(dose, str):
        if dose != AIR:
            raise DataError(f"dose: expected numbers or {AIR!r}, got {dose!r}")
        return dose
    values = _by_view("dose", 1 if dose is None else dose, count)
    if not (values > 0).all():
        k = int(np.flatnonzero(values <= 0)[0])
        raise DataError(f"dose: view {k} has {values[k]:g}; expected an exposure above 0, relative to the flat")
    return values


def _electronic(given: float | None, darks: AnyArray, kinds: UInt8) -> float:
    if given is not None:
        if not given >= 0:
            raise DataError(f"electronic: expected a standard deviation of 0 or more, got {given:g}")
        return float(given)
    if len(darks) < 2:
        return 0.0
    frames = darks.astype(np.float64)
    return float(np.sqrt(frames.var(axis=0, ddof=1)[kinds == GOOD].mean()))


def _amplification(lag: Lag, frames: int) -> float:
    """How much the removal of lag raises noise that has none, such as that of the read-out."""
    pulse = np.zeros((frames, 1, 1))
    pulse[0] = 1
    return float(np.linalg.norm(deconvolve_lag(pulse, lag)))


def _by_view(name: str, values: ArrayLike, count: int) -> Float64:
    numbers = np.asarray(values, np.float64)
    if numbers.shape not in ((), (count,)) or not np.isfinite(numbers).all():
        raise DataError(f"{name}: expected a finite number, or {count}, one a view; got shape {numbers.shape}")
    return np.broadcast_to(numbers, count)


def _gain(
    given: ArrayLike | None, beams: Float32, sigma: float, kinds: UInt8, pattern: Float64, by_view: bool
) -> Float64:
    """Digital units a photon of each pixel."""
    if given is None:
        if len(beams) < 2 or by_view:
            what = "frames of different views tell" if by_view else "one flat tells"
            raise DataError(
                f"gain: {what} no noise; give the digital units that a photon makes (gain=), or a stack of flats that "
                f"repeat each other"
            )
        return photon_transfer_gain(beams, 0, sigma, kinds == GOOD, pattern) * np.where(kinds == GOOD, pattern, 1)
    units = float32("gain", given).astype(np.float64).reshape(np.shape(given))
    if units.ndim and units.shape != kinds.shape:
        raise DataError(f"gain: expected a number or {kinds.shape}, one a pixel, got {units.shape}")
    if not (units if not units.ndim else units[kinds == GOOD]).min() > 0:
        raise DataError(f"gain: expected digital units a photon, above 0, found {units.min():g}")
    return np.where(kinds == GOOD, units if units.ndim else units * pattern, 1.0)


def _beam(
    signal: Float64,
    beams: Float32,
    profiles: Sequence[BeamProfile],
    views: Views,
    place: int,
    final: bool,
    notes: list[str],
) -> AnyArray:
    """(views, rows, columns): what each view would read without object at the flat's dose, digital units."""
    if final:
        return np.broadcast_to(beams, views.shape)
    there = profiles[0].on(views.source[place], views.panels[place])
    changes = []
    for source, panel in zip(views.source, views.panels, strict=True):
        change = profiles[0].on(source, panel) / there
        changes.append(np.broadcast_to(1.0, signal.shape) if np.allclose(change, 1, atol=1e-6) else change)
    largest = max(float(np.abs(change - 1).max()) for change in changes)
    if largest > 0:
        notes.append(
            f"flat: taken as from the tube's place in view {place}; for the others its beam was changed by up to "
            f"{largest:.1%} (inverse square law, obliquity, heel effect of a tube that aims at the panel's middle)"
        )
    return np.stack([(signal * change).astype(np.float32) for change in changes])
