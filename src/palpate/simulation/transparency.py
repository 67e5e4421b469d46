"""Whether a hand feels the tissue or the chain before it: dynamic stiffness at the device against the tissue's own."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import ArrayLike, Complex128, Float64, float64
from palpate.errors import DataError, MaterialError
from palpate.simulation.pointer import Kind
from palpate.simulation.rendered_chain import TICK, RenderedChain
from palpate.simulation.session import RATE
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.relaxation import Relaxation
from palpate.tissue.tissue import Tissue

HIGHEST = 250.0  # Hz: four ticks a period
REST = 0.2  # s at the depth before the first frequency
TRANSIENT = 0.5  # s of each frequency that are left out
FITTED, PERIODS = 0.5, 2  # s and periods that are fitted, at least
DECIBELS, DEGREES = 3.0, 45.0  # where a bandwidth ends


@dataclass(frozen=True, eq=False)
class Transparency:
    """Dynamic stiffness that a hand feels, and that of the tissue.

    The hand moves as d + a sin(ωt), the force is that of one tick, and its part of that frequency, over a, is the dynamic
    stiffness: the real part stores energy, the imaginary part dissipates it. A device that holds each force until the
    next tick adds a lag of 0.18° for each Hz, which is not counted here.

    Parameters
    ----------
    frequencies : ndarray, (n,)
        Hz.
    rendered : ndarray, (n,), complex
        Dynamic stiffness at the device, N/mm.
    tissue : ndarray, (n,), complex
        That of the tissue, N/mm.
    distortion : ndarray, (n,)
        Root mean square of what in the force is no sinusoid, over that of the sinusoid. Above some 0.05 a limit, a
        contact that opens, or a passivity controller is at work.
    amplitude : float
        a, mm.
    depth : float
        d, mm.

    Attributes
    ----------
    ratio : ndarray, (n,), complex
        Rendered over the tissue's own; 1 is transparent.

    Examples
    --------
    >>> felt = pp.transparency(pp.model(tissue, "compliance"), top, 10, [1, 10])
    >>> felt.ratio.real.round(2)
    array([1., 1.])
    """

    frequencies: Float64
    rendered: Complex128
    tissue: Complex128
    distortion: Float64
    amplitude: float
    depth: float

    @property
    def ratio(self) -> Complex128:
        """Rendered over the tissue's own."""
        return self.rendered / self.tissue

    @property
    def decibels(self) -> Float64:
        """Magnitude of the ratio, dB, (n,)."""
        return np.asarray(20 * np.log10(np.maximum(np.abs(self.ratio), 1e-12)))

    @property
    def phase(self) -> Float64:
        """Phase of the ratio, degrees, (n,); below zero the force lags."""
        return np.degrees(np.angle(self.ratio))

    @property
    def dissipated(self) -> Float64:
        """Energy that the hand loses in a period, N mm, (n,). Below zero the chain drives the hand."""
        return np.asarray(np.pi * self.amplitude**2 * self.rendered.imag)

    @property
    def bandwidth(self) -> float:
        """Frequency at which the ratio first leaves ±3 dB or ±45°, Hz; inf if it never does, 0 if it begins outside."""
        order = np.argsort(self.frequencies)
        excess = np.maximum(np.abs(self.decibels) / DECIBELS, np.abs(self.phase) / DEGREES)[order]
        place = np.log(self.frequencies[order])
        outside = np.flatnonzero(excess > 1)
        if not len(outside):
            return float("inf")
        k = outside[0]
        if k == 0:
            return 0.0
        return float(np.exp(np.interp(1.0, excess[k - 1 : k + 1], place[k - 1 : k + 1])))


def transparency(
    model: TissueModel,
    point: ArrayLike,
    radius: float,
    frequencies: ArrayLike,
    *,
    amplitude: float = 0.1,
    depth: float = 1.0,
    kind: Kind = "free",
    coupling: float | None = None,
    limit: float = 20.0,
    sweeps: int | None = None,
) -> Transparency:
    """Measure the dynamic stiffness that a session renders, without a clock.

    A tool presses along the normal, swings by `amplitude` about `depth`, and a sinusoid is fitted to the force that a device
    would be given.

    Parameters
    ----------
    model : TissueModel
        The model, from `pp.model`.
    point : array_like, (3,)
        Where the tool presses, mm.
    radius : float
        Of the contact, mm.
    frequencies : array_like, (n,)
        Hz, more than 0 and at most 250.
    amplitude : float, optional
        mm, less than `depth`.
    depth : float, optional
        mm below the surface at rest.
    kind : {"free", "hold"}, optional
        A tool in space, as devices send it, or one that holds the tissue, whose motion is low-pass filtered.
    coupling : float, optional
        Stiffness of the spring between hand and tool, N/mm, as a device with motors has it. By default there is none.
    limit : float, optional
        Largest force on the device, N.
    sweeps : int, optional
        Sweeps of the model in a tick, as in `Session`.

    Returns
    -------
    Transparency
        Both stiffnesses, their ratio and its bandwidth.

    Raises
    ------
    DataError
        If a number is not valid, or the point is off the surface.
    MaterialError
        If the dynamic stiffness of the tissue itself is not known: it has inertia, or its parts relax differently.

    References
    ----------
    Lawrence, Stability and transparency in bilateral teleoperation, IEEE Trans. Robot. Autom. 9 (1993) 624.

    Examples
    --------
    >>> felt = pp.transparency(pp.model(tissue, "compliance"), top, 10, [1, 10, 100], kind="hold")
    >>> 5 < felt.bandwidth < 20
    True
    """
    hertz = float64("frequencies", frequencies, (None,))
    if not len(hertz) or not ((hertz > 0) & (hertz <= HIGHEST)).all():
        raise DataError(f"frequencies: {hertz.tolist()} Hz; give some more than 0 and at most {HIGHEST:g}")
    if not (np.isfinite(depth) and depth > 0):
        raise DataError(f"depth: {depth:g} mm, expected more than 0")
    if not 0 < amplitude < depth:
        raise DataError(f"amplitude: {amplitude:g} mm, expected more than 0 and less than the depth, {depth:g}")
    relaxes = _modulus(model.tissue, hertz)
    chain = RenderedChain(model, point, radius, kind=kind, coupling=coupling, limit=limit, sweeps=sweeps)
    own = contact_stiffness(model, chain, radius, depth, amplitude) * relaxes
    chain.press(depth, REST)
    found = [_response(chain, f, amplitude, depth, model.tissue) for f in hertz.tolist()]
    rendered, distortion = (np.array(values) for values in zip(*found, strict=True))
    return Transparency(hertz, rendered, own, distortion, float(amplitude), float(depth))


def _modulus(tissue: Tissue, hertz: Float64) -> Complex128:
    """Complex modulus over that in the long term, at each frequency."""
    if tissue.inertia is not None:
        raise MaterialError("transparency: the tissue has inertia; take it without: tissue.replace(inertia=None)")
    if tissue.relaxation is None:
        return np.ones(len(hertz), dtype=np.complex128)
    if not (isinstance(tissue.relaxation, Relaxation) and tissue.relaxes_alike):
        raise MaterialError(
            "transparency: parts of the tissue relax differently; give one relaxation for shear and bulk"
        )
    return tissue.relaxation.complex_modulus(hertz)


def contact_stiffness(model: TissueModel, chain: RenderedChain, radius: float, depth: float, amplitude: float) -> float:
    """N/mm in the long term, of a press along the normal about `depth` mm: between both ends of the swing."""
    inward = -chain.normal
    low, high = (
        float(model.push(chain.point, d * inward, radius, tolerance=1e-5).force @ chain.normal)
        for d in (depth - amplitude, depth + amplitude)
    )
    return (high - low) / (2 * amplitude)


def _response(
    chain: RenderedChain, frequency: float, amplitude: float, depth: float, tissue: Tissue
) -> tuple[complex, float]:
    """The force's part of a frequency over the amplitude, N/mm, and the distortion; by least squares."""
    periods = max(PERIODS, int(np.ceil(FITTED * frequency)))
    t = TICK * np.arange(1, round((TRANSIENT + periods / frequency) * RATE) + 1)
    angle = 2 * np.pi * frequency * t
    force = np.array([chain.tick(x) for x in (depth + amplitude * np.sin(angle)).tolist()])
    # What is left of the press fades with the relaxation's own times, and would look like a part of a slow sinusoid.
    times = tissue.relaxation.times if isinstance(tissue.relaxation, Relaxation) else ()
    fading = [np.exp(-t / time) for time in times]
    columns = np.stack([np.sin(angle), np.cos(angle), np.ones_like(t), t, *fading], axis=1)
    kept = t > TRANSIENT
    weights = np.linalg.lstsq(columns[kept], force[kept], rcond=None)[0]
    left = force[kept] - columns[kept] @ weights
    size = np.hypot(weights[0], weights[1])
    distortion = float(np.sqrt((left**2).mean()) / max(size / np.sqrt(2), 1e-12))
    return complex(weights[0], weights[1]) / amplitude, distortion
