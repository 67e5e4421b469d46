"""How far a lump can be trusted: its size, depth and contrast, the force that it adds, and whether a hand feels it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from palpate.arrays import Float32, Float64
from palpate.errors import DataError
from palpate.tissue.interval_correction import IntervalCorrection, sample_interval
from palpate.tissue.tissue import Tissue

QUANTITIES = {
    "diameter": "mm",
    "depth": "mm below the place that is pushed",
    "contrast": "1/mm",
    "added": "N",
    "share": "of the force without it",
}
WEBER = 0.10
WEBER_TOLD = (0.05, 0.10, 0.15, 0.20)
WEBER_SOURCE = (
    "about 7 % of forces of 2.5 to 10 N between thumb and finger: Pang, Tan & Durlach, Percept. Psychophys. 49 (1991) 531; "
    "about 7 % of forces of the elbow's flexors: Jones, Perception 18 (1989) 681, not verified"
)


@dataclass(frozen=True, eq=False)
class LumpUncertainty:
    """What the samples of a posterior say of a lump, and of the force that a hand feels over it.

    Parameters
    ----------
    tissue : Tissue
        The body without the lump.
    point, normal : ndarray, (3,)
        Where the hand pushes, mm, and the outward unit normal there.
    diameter, depth, contrast : ndarray, (samples,)
        Of the ball of equal volume, mm; of the centre of mass below `point`, mm along the normal; and of the attenuation
        within the MAP estimate's outline over that around it, 1/mm.
    weights : ndarray, (z, y, x)
        The contrast is Σ weights · f, so that `Posterior.linear_std` of them is its standard deviation to first order.
    plain, added : ndarray, (draws,)
        Force of the push without the lump, and what the lump adds, N.
    places : ndarray, (P, 3)
        Of the force map, mm.
    forces, plain_forces : ndarray, (draws, P)
        Force of the same push at each place with and without the lump, N.
    push, radius : float
        Depth of the push and radius of the contact, mm.
    corrections : mapping of str to IntervalCorrection, optional
        By quantity; intervals and probabilities are corrected by them.

    Examples
    --------
    >>> found = pp.posterior(scan, grid, samples=9, levels=1)
    >>> doubt = pp.lump_uncertainty(found, tissue, lump=(50, 10), near=(0, 0, 27), radius=10)
    >>> low, high = doubt.interval("diameter", level=0.8)
    >>> 0 <= doubt.probability_felt() <= 1
    True
    """

    tissue: Tissue
    point: Float64
    normal: Float64
    diameter: Float64
    depth: Float64
    contrast: Float64
    weights: Float32
    plain: Float64
    added: Float64
    places: Float64
    forces: Float64
    plain_forces: Float64
    push: float
    radius: float
    corrections: Mapping[str, IntervalCorrection] = field(default_factory=dict)

    @property
    def share(self) -> Float64:
        """(draws,) the added force over that without the lump."""
        return np.asarray(self.added / self.plain)

    def values(self, quantity: str) -> Float64:
        """Return the samples of a quantity.

        Parameters
        ----------
        quantity : {"diameter", "depth", "contrast", "added", "share"}
            The quantity; "share" is the added force over that without the lump.

        Returns
        -------
        ndarray
            One for each sample, or for each draw of the stiffness.

        Raises
        ------
        DataError
            If the quantity is not known.
        """
        if quantity not in QUANTITIES:
            raise DataError(f"quantity: {quantity!r} is not known; choose one of {', '.join(QUANTITIES)}")
        return np.asarray(getattr(self, quantity))

    def interval(self, quantity: str, level: float = 0.9) -> tuple[float, float]:
        """Return the interval that holds a quantity with a probability.

        Parameters
        ----------
        quantity : str
            As for `values`.
        level : float, optional
            The probability. Without a correction the ends are quantiles of the samples, so that few allow no high level.

        Returns
        -------
        tuple of float
            The lower and the upper end.

        Raises
        ------
        DataError
            If the quantity is not known, or the samples are too few for the level.
        """
        values = self.values(quantity)
        if quantity in self.corrections:
            return self.corrections[quantity].interval(values, level)
        return sample_interval(values, level)

    def probability_felt(self, weber: float = WEBER) -> float:
        """Return the probability that a hand feels the lump.

        Parameters
        ----------
        weber : float, optional
            The least added force that is felt, as a share of the force there. 7 to 10 % are measured.

        Returns
        -------
        float
            The share of the draws above it, or the corrected probability.

        Raises
        ------
        DataError
            If the fraction is not positive.
        """
        if not weber > 0:
            raise DataError(f"weber: {weber!r}; give a share of the force above 0, such as {WEBER}")
        if "share" in self.corrections:
            return self.corrections["share"].probability_above(self.share, weber)
        return float(np.mean(self.share > weber))

    def band(self, quantity: str = "force", level: float = 0.9) -> tuple[Float64, Float64]:
        """Return the pointwise band of the force map, without a correction.

        Parameters
        ----------
        quantity : {"force", "share"}, optional
            The force with the lump, N, or what the lump adds over the force without it.
        level : float, optional
            The probability with which the band holds the value of each place.

        Returns
        -------
        tuple of ndarray, (P,)
            The lower and the upper value.

        Raises
        ------
        DataError
            If the quantity is not known, or the draws are too few for the level.
        """
        if quantity not in ("force", "share"):
            raise DataError(f"quantity: {quantity!r} has no band; choose force or share")
        values = self.forces if quantity == "force" else self.forces / self.plain_forces - 1
        ends = np.array([sample_interval(each, level) for each in values.T]).reshape(-1, 2)
        return ends[:, 0], ends[:, 1]

    def text(self, level: float = 0.9) -> str:
        """Return the verdict for people.

        Parameters
        ----------
        level : float, optional
            Probability of the intervals.

        Returns
        -------
        str
            The probability that a hand feels the lump, intervals, and what they rest on, a line each.
        """
        (d, z, c, f, s) = (self.interval(name, level) for name in QUANTITIES)
        felt = "; ".join(f"{self._told(w)} at {w:.0%}" for w in WEBER_TOLD)
        corrected = "corrected by what other bodies taught" if self.corrections else "not corrected"
        return "\n".join(
            [
                f"a hand feels the lump with a probability of {self._told(WEBER)}: that it adds more than "
                f"{WEBER:.0%} of the force there ({WEBER_SOURCE}); by other Weber fractions: {felt}",
                f"pushed {self.push:.3g} mm in with a patch of radius {self.radius:.3g} mm at "
                f"{np.round(self.point, 1).tolist()} mm, it adds {f[0]:.2g} to {f[1]:.2g} N, {100 * s[0]:.2g} to "
                f"{100 * s[1]:.2g} % ({level:.0%} interval)",
                f"{level:.0%} intervals: diameter {d[0]:.2f} to {d[1]:.2f} mm, centre {z[0]:.1f} to {z[1]:.1f} mm below the "
                f"place that is pushed, contrast {c[0]:.4f} to {c[1]:.4f} 1/mm",
                f"of {len(self.diameter)} samples of the posterior and {len(self.added)} draws of the stiffness, {corrected}",
            ]
        )

    def _told(self, weber: float) -> str:
        """The probability in words; of n draws none says no more than that it is below 1 / (n + 1)."""
        told, least = self.probability_felt(weber), 1 / (len(self.added) + 1)
        return f"below {least:.0%}" if told < least else f"above {1 - least:.0%}" if told > 1 - least else f"{told:.0%}"
