"""Image lag of a panel: a part of the charge of a frame is read out with later frames."""

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from palpate.arrays import AnyArray, ArrayLike, Float32, Float64, float32, float64
from palpate.errors import DataError

MOST = 0.5  # of the signal in the first frame after it: above it, the beam was still on
TWO_TERMS = 6  # frames of after-glow from which two exponentials are fitted


@dataclass(frozen=True)
class Lag:
    """Impulse response of a panel with lag: h(0) (1, then the sum over terms of a ρᵏ⁻¹ for k = 1, 2, ... frames).

    h(0) is such that all adds up to 1: a beam that stays on reads its own value in the end.

    Parameters
    ----------
    terms : sequence of (float, float)
        Amplitude a, relative to the signal of the frame itself, and decay ρ from frame to frame, of each exponential.

    Raises
    ------
    DataError
        If an amplitude is negative, or a decay is not in [0, 1).

    Examples
    --------
    >>> pp.Lag.first_order(0.03).response(3)[:2]
    array([0.97  , 0.0291])
    """

    terms: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        terms = tuple((float(a), float(decay)) for a, decay in self.terms)
        for a, decay in terms:
            if not (0 <= a < 1 and 0 <= decay < 1):
                raise DataError(
                    f"lag: expected an amplitude and a decay a frame in 0 to 1, below 1, got {a:g} and {decay:g}; "
                    f"3 % of lag is 0.03"
                )
        object.__setattr__(self, "terms", terms)

    @classmethod
    def first_order(cls, share: float) -> "Lag":
        """Return the lag of the recursive filter y(k) = (1 − share) x(k) + share · y(k − 1).

        Parameters
        ----------
        share : float
            Signal in the first frame after a long exposure, relative to the exposure.

        Returns
        -------
        Lag
            One term with a = ρ = share.
        """
        return cls(((share, share),)) if share != 0 else cls()

    @property
    def first(self) -> float:
        """h(0), the share of a frame's charge that is read out with the frame itself."""
        return 1 / (1 + sum(a / (1 - decay) for a, decay in self.terms))

    def response(self, frames: int) -> Float64:
        """Return the impulse response.

        Parameters
        ----------
        frames : int
            How many frames.

        Returns
        -------
        ndarray, (frames,)
            h(0), h(1), ...
        """
        k = np.arange(frames)
        later = sum((a * decay ** np.maximum(k - 1, 0) for a, decay in self.terms), start=np.zeros(frames))
        return self.first * np.where(k == 0, 1.0, later)


def deconvolve_lag(frames: ArrayLike, lag: Lag) -> Float32:
    """Remove the lag from frames that were read out one after the other, the panel at rest before the first.

    The recursion is exact: with y the read-out and S_n the charge that term n still holds,
    x(k) = y(k) / h(0) − Σ S_n(k), and S_n(k + 1) = ρ_n S_n(k) + a_n x(k).

    Parameters
    ----------
    frames : array_like, (frames, rows, columns)
        Read-out with its offset subtracted, in the order of time.
    lag : Lag
        The impulse response.

    Returns
    -------
    ndarray, (frames, rows, columns)
        What each frame would have read without lag. The noise of photons stays Poisson: their charge is put back whole.

    Raises
    ------
    DataError
        If the frames have another shape or are not finite.

    References
    ----------
    Hsieh, Gurmen and King, Proc. SPIE 3977:298, 2000; Starman et al., Med. Phys. 38:2398, 2011.

    Examples
    --------
    >>> frames = np.stack([np.full((2, 2), v) for v in (97.0, 2.91, 0.0873)])
    >>> pp.deconvolve_lag(frames, pp.Lag.first_order(0.03))[:, 0, 0].round(4).tolist()
    [100.0, 0.0, 0.0]
    """
    y = float32("frames", frames, (None, None, None))
    if not lag.terms:
        return y
    x, held = np.empty_like(y), [np.zeros(y.shape[1:]) for _ in lag.terms]
    for k, read in enumerate(y):
        x[k] = read / lag.first - sum(held)
        for part, (a, decay) in zip(held, lag.terms, strict=True):
            part *= decay
            part += a * x[k]
    return x


def lag_from_afterglow(afterglow: ArrayLike, exposed: ArrayLike, dark: ArrayLike = 0) -> Lag:
    """Estimate the lag from frames that were read out after a long, steady exposure.

    After an exposure s that lasted, frame k = 1, 2, ... reads s Σ_n h(0) a_n ρ_nᵏ⁻¹ / (1 − ρ_n). One frame gives the lag
    of the first order, more give one exponential, and six or more give two.

    Parameters
    ----------
    afterglow : array_like, (frames, rows, columns) or (rows, columns)
        Frames without beam, the first right after the exposure.
    exposed, dark : array_like, (rows, columns)
        What a pixel reads during the exposure, and long after it. Dead pixels weigh little.

    Returns
    -------
    Lag
        The impulse response. It has no terms where no after-glow stands above the dark.

    Raises
    ------
    DataError
        If shapes differ, or the frames are too bright for an after-glow.

    References
    ----------
    Starman et al., Med. Phys. 38:2398, 2011 (falling step response).

    Examples
    --------
    >>> left = np.stack([np.full((4, 4), 1000 * 0.03**k) for k in (1, 2)])
    >>> [round(float(v), 4) for v in pp.lag_from_afterglow(left, np.full((4, 4), 1000.0)).terms[0]]
    [0.03, 0.03]
    """
    shown = np.asarray(afterglow)
    shown = float64("afterglow", shown[None] if shown.ndim == 2 else shown, (None, None, None))
    offset = np.broadcast_to(float64("dark", dark), shown.shape[1:])
    signal = float64("exposed", exposed, shown.shape[1:]) - offset
    good = signal > 0.5 * np.median(signal)
    if not good.any() or np.median(signal) <= 0:
        raise DataError("exposed: no brighter than the dark; give the frame that was read during the exposure")
    left = np.array([(frame - offset)[good].mean() for frame in shown]) / signal[good].mean()
    spread = [1.5 * np.median(np.abs(v - np.median(v))) for v in ((frame - offset)[good] for frame in shown)]
    noise = np.array(spread) / np.sqrt(good.sum()) / signal[good].mean()
    if left[0] > MOST:
        raise DataError(
            f"afterglow: its first frame reads {left[0]:.0%} of the exposure; leave out frames in which the beam was on"
        )
    if left[0] <= max(3 * noise[0], 1e-6):
        return Lag()
    return _fitted(left)


def _fitted(left: Float64) -> Lag:
    """The lag whose falling step response is `left`: sums of A ρᵏ⁻¹ with A = h(0) a / (1 − ρ)."""
    if len(left) == 1:
        return Lag.first_order(float(left[0]))
    k = np.arange(len(left))

    def amplitudes_of(decays: AnyArray) -> tuple[Float64, float]:
        amplitudes, misfit = optimize.nnls(np.stack([d**k for d in np.clip(decays, 0, 0.999)], axis=1), left)
        return amplitudes, float(misfit) / float(left[0])

    grid = np.array([0.0, *np.linspace(0.02, 0.98, 33)])
    pairs = [(d, e) for d in grid for e in grid if e < d]
    starts: list[Float64] = list(np.array(pairs) if len(left) >= TWO_TERMS else grid[:, None])

    def misfit(decays: Float64) -> float:
        return amplitudes_of(decays)[1]

    found = optimize.fmin(misfit, min(starts, key=misfit), xtol=1e-7, ftol=1e-12, maxiter=2000, disp=False)
    decays = np.clip(found, 0, 0.999)
    amplitudes = amplitudes_of(decays)[0]
    rest = 1 - amplitudes.sum()  # h(0): what is left of the step at its first frame is all but h(0)
    if rest <= 0:
        raise DataError("afterglow: it holds more than the exposure; check its order and the dark")
    terms = [(A * (1 - d) / rest, d) for A, d in zip(amplitudes, decays, strict=True) if A > 0]
    return Lag(tuple((float(a), float(d)) for a, d in terms))
