"""What is measured of a tissue: one record for each quantity, with its source."""

from dataclasses import dataclass

from palpate.errors import DataError, MaterialError

QUANTITIES = {
    "young": ("Young's modulus", "kPa"),
    "poisson": ("Poisson's ratio", ""),
    "density": ("density", "kg/m³"),
    "relaxed": ("relaxed fraction", ""),
    "relaxation_time": ("relaxation time", "s"),
    "slow_relaxation_time": ("slow relaxation time", "s"),
    "stiffening": ("stiffening exponent", ""),
    "fracture_energy": ("fracture energy", "J/m²"),
}
"""Field of `TissueProperties`: its name in words, and its unit."""


@dataclass(frozen=True)
class Measured:
    """One quantity of a tissue, as a paper prints it.

    Parameters
    ----------
    value : float or None
        The value, in `unit`. None where the source prints a range and no mean.
    unit : str
        Its unit, empty for a ratio.
    spread : float, optional
        One standard deviation, or the ± of the source.
    low, high : float, optional
        Lowest and highest value of the source.
    printed : str, optional
        What the source prints, where `value` is computed from it.
    method : str
        Method, strain or frequency, species, in or ex vivo.
    source : str
        Authors, journal, year.
    doi : str, optional
        Its DOI; empty where it is not certain.
    verified : bool, optional
        True if the number was looked up in the source, its abstract, or a table that quotes it. False is "not verified".

    Examples
    --------
    >>> stiff = pp.tissue_properties("kidney").young
    >>> stiff.text
    '14.7 ± 1.5 kPa'
    >>> stiff.doi
    '10.1002/jmri.22670'
    """

    value: float | None
    unit: str
    spread: float | None = None
    low: float | None = None
    high: float | None = None
    printed: str = ""
    method: str = ""
    source: str = ""
    doi: str = ""
    verified: bool = False

    @property
    def text(self) -> str:
        """Value, spread or range, and unit."""
        parts = [] if self.value is None else [f"{self.value:g}"]
        if self.spread is not None:
            parts.append(f"± {self.spread:g}")
        if self.low is not None or self.high is not None:
            span = " to ".join(f"{end:g}" for end in (self.low, self.high) if end is not None)
            parts.append(f"({span})" if parts else span)
        return " ".join([*parts, self.unit]).strip()

    @property
    def citation(self) -> str:
        """Method, source and DOI, what the source prints, and whether it was looked up."""
        printed = f", printed as {self.printed}" if self.printed else ""
        doi = f", doi {self.doi}" if self.doi else ""
        return f"{self.method}; {self.source}{doi}{printed}{'' if self.verified else '; not verified'}"


@dataclass(frozen=True)
class TissueProperties:
    """What is known of a tissue; a quantity that is None is unknown.

    Parameters
    ----------
    name : str
        Name of the tissue.
    young : Measured or None
        Young's modulus at small strain, kPa.
    poisson : Measured or None
        Poisson's ratio.
    density : Measured or None
        Mass density, kg/m³.
    relaxed : Measured or None
        Share of the stress that is gone in the end when a strain is held, 0 to 1.
    relaxation_time, slow_relaxation_time : Measured or None
        Time constants of the relaxation, s.
    stiffening : Measured or None
        Exponent n of the shear modulus, which grows as C⁻ⁿ when C falls from 1 in compression; not that of `Tissue`.
    fracture_energy : Measured or None
        Work for each area of new surface, J/m².

    Examples
    --------
    >>> liver = pp.tissue_properties("liver")
    >>> liver.fracture_energy.text
    '164 ± 6 J/m²'
    >>> liver.poisson is None
    True
    """

    name: str
    young: Measured | None = None
    poisson: Measured | None = None
    density: Measured | None = None
    relaxed: Measured | None = None
    relaxation_time: Measured | None = None
    slow_relaxation_time: Measured | None = None
    stiffening: Measured | None = None
    fracture_energy: Measured | None = None

    def measured(self, quantity: str) -> Measured | None:
        """Return the record of a quantity.

        Parameters
        ----------
        quantity : str
            Name of a field, such as "young".

        Returns
        -------
        Measured or None
            The record; None if the quantity is unknown.

        Raises
        ------
        DataError
            If there is no such quantity.
        """
        if quantity not in QUANTITIES:
            raise DataError(f"quantity: {quantity!r} is not in the table; choose one of {', '.join(QUANTITIES)}")
        found: Measured | None = getattr(self, quantity)
        return found

    def described(self, quantity: str) -> str:
        """Return a quantity with its method and source.

        Parameters
        ----------
        quantity : str
            Name of a field, such as "young".

        Returns
        -------
        str
            Value, spread, unit and source; "unknown" if the quantity is unknown.

        Raises
        ------
        DataError
            If there is no such quantity.
        """
        found = self.measured(quantity)
        return "unknown" if found is None else f"{found.text} ({found.citation})"

    def required(self, quantity: str) -> float:
        """Return the value of a quantity that a calculation cannot do without.

        Parameters
        ----------
        quantity : str
            Name of a field, such as "fracture_energy".

        Returns
        -------
        float
            The value, in the unit of the quantity.

        Raises
        ------
        MaterialError
            If the quantity is unknown, or only a range was measured. The user must give it.
        DataError
            If there is no such quantity.
        """
        found = self.measured(quantity)
        words, unit = QUANTITIES[quantity]
        yours = f"give the {words}{f' in {unit}' if unit else ''} yourself"
        if found is None:
            raise MaterialError(f"{quantity}: unknown for {self.name}, no measurement is in the table; {yours}")
        if found.value is None:
            raise MaterialError(f"{quantity}: the table has only a range for {self.name}, {found.text}; {yours}")
        return found.value
