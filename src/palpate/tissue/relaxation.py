"""How the stiffness of a tissue relaxes after it has been strained."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from palpate.arrays import ArrayLike, Complex128, Float64
from palpate.errors import MaterialError

MOST_TERMS = 6
LEAST_LEFT = 1e-3  # of the instantaneous modulus


@dataclass(frozen=True)
class Relaxation:
    """A Prony series of a tissue's stiffness.

    Just after a strain the modulus is E₀, and t seconds later E₀ (1 − Σ gₖ (1 − exp(−t/τₖ))). A tissue's `young` is what
    remains in the long term, E₀ (1 − Σ gₖ). The bulk of tissue hardly relaxes. Near ν = 0.5 that matters little; at 0.3 the
    force rises by a quarter to a third less if shear alone relaxes (`benchmarks/tissue_in_time.py`).

    Parameters
    ----------
    shares : sequence of float
        The gₖ: parts of the instantaneous modulus, no unit. They sum to less than 1.
    times : sequence of float
        The relaxation times τₖ, s, from 0.001 to 1e6.
    bulk : bool, optional
        Whether the bulk modulus relaxes as the shear modulus does. If not, Poisson's ratio is less at first.

    Raises
    ------
    MaterialError
        If a number is out of its range, or there are more than six terms.

    References
    ----------
    Christensen, Theory of Viscoelasticity, 2nd ed., 1982, section 1.5.

    Examples
    --------
    >>> pp.Relaxation((0.5,), (0.2,)).modulus([0, 0.2, 100])
    array([2.        , 1.36787944, 1.        ])
    """

    shares: tuple[float, ...]
    times: tuple[float, ...]
    bulk: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "shares", tuple(float(g) for g in self.shares))
        object.__setattr__(self, "times", tuple(float(t) for t in self.times))
        if not 1 <= len(self.shares) == len(self.times) <= MOST_TERMS:
            raise MaterialError(
                f"relaxation: {len(self.shares)} shares and {len(self.times)} times; give 1 to {MOST_TERMS} of each"
            )
        for share, time in zip(self.shares, self.times, strict=True):
            if not 0 < share < 1:
                raise MaterialError(f"relaxation: a share of {share:g}; give more than 0 and less than 1, such as 0.4")
            if not 1e-3 <= time <= 1e6:
                raise MaterialError(f"relaxation: a time of {time:g} s; give 0.001 s (a tick) to 1e6 s")
        if sum(self.shares) > 1 - LEAST_LEFT:
            raise MaterialError(f"relaxation: the shares sum to {sum(self.shares):g}; a solid needs less than 1")

    @classmethod
    def parse(cls, text: str, bulk: bool = True) -> Self:
        """Return the relaxation that a text gives.

        Parameters
        ----------
        text : str
            Shares, and the times in s with which they relax, such as "0.3@0.1,0.2@2".
        bulk : bool, optional
            Whether the bulk modulus relaxes, too.

        Returns
        -------
        Relaxation
            The series.

        Raises
        ------
        MaterialError
            If the text is not of this form, or a number is out of its range.

        Examples
        --------
        >>> pp.Relaxation.parse("0.3@0.1,0.2@2").times
        (0.1, 2.0)
        """
        try:
            pairs = [(float(share), float(time)) for share, time in (part.split("@") for part in text.split(","))]
        except ValueError:
            raise MaterialError(f"relaxation: {text!r}; give share@seconds, such as 0.3@0.1,0.2@2") from None
        return cls(tuple(share for share, _ in pairs), tuple(time for _, time in pairs), bulk)

    @property
    def instantaneous(self) -> float:
        """Modulus just after a strain, over that in the long term."""
        return 1 / (1 - sum(self.shares))

    def modulus(self, time: ArrayLike) -> Float64:
        """Return the modulus after a strain.

        Parameters
        ----------
        time : array_like
            Times after the strain, s.

        Returns
        -------
        ndarray
            Modulus over that in the long term, no unit, of the shape of `time`.

        Examples
        --------
        >>> float(pp.Relaxation((0.5,), (0.2,)).modulus(0))
        2.0
        """
        t = np.asarray(time, dtype=np.float64)
        ratios = self.instantaneous * np.array(self.shares)
        return np.asarray(1 + np.exp(-t[..., None] / np.array(self.times)) @ ratios)

    def at_rate(self, s: float) -> float:
        """Return the modulus at the Laplace variable s.

        Parameters
        ----------
        s : float
            1/s, 0 or more; inf is the instant after a strain.

        Returns
        -------
        float
            Modulus over that in the long term, no unit.

        Examples
        --------
        >>> pp.Relaxation((0.5,), (0.2,)).at_rate(5)
        1.5
        """
        if np.isinf(s):
            return self.instantaneous
        x = s * np.array(self.times)
        return float(1 + self.instantaneous * (np.array(self.shares) * x / (1 + x)).sum())

    def complex_modulus(self, frequency: ArrayLike) -> Complex128:
        """Return the complex modulus under a sinusoidal strain.

        Parameters
        ----------
        frequency : array_like
            Hz, 0 or more.

        Returns
        -------
        ndarray
            Storage modulus and, as the imaginary part, loss modulus, over the modulus in the long term; of the shape of
            `frequency`.

        References
        ----------
        Christensen, Theory of Viscoelasticity, 2nd ed., 1982, section 1.6.

        Examples
        --------
        >>> complex(pp.Relaxation((0.5,), (0.2,)).complex_modulus(5 / (2 * np.pi)).round(3))
        (1.5+0.5j)
        """
        x = 2j * np.pi * np.asarray(frequency, dtype=np.float64)[..., None] * np.array(self.times)
        return np.asarray(1 + x / (1 + x) @ (self.instantaneous * np.array(self.shares)))

    @property
    def text(self) -> str:
        """What it means, in a sentence."""
        parts = " and ".join(f"{g:.0%} with {t:g} s" for g, t in zip(self.shares, self.times, strict=True))
        what = "stiffness" if self.bulk else "stiffness in shear alone"
        return f"just after a strain {what} is {self.instantaneous:.3g} times that in the long term; {parts} relax"

    def table(self) -> Float64:
        """Return shares and times as an array.

        Returns
        -------
        ndarray, (terms, 2)
            A share (no unit) and a time (s) in each row.

        Examples
        --------
        >>> pp.Relaxation((0.5,), (0.2,)).table().shape
        (1, 2)
        """
        return np.column_stack([self.shares, self.times])
