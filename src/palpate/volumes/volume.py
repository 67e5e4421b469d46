"""Volumes of attenuation, and labels."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from typing import Any

import numpy as np

from palpate.arrays import AnyArray, Float32, Int32, as_numpy, float32
from palpate.errors import DataError
from palpate.volumes.grid import Grid

SHOWN = 6  # labels that a message names


@dataclass(frozen=True, eq=False)
class Volume:
    """Values on a grid.

    Parameters
    ----------
    values : array_like, (z, y, x)
        The values; stored as float32.
    grid : Grid
        Where the voxels lie.
    unit : str, optional
        Unit of the values. The default "1/mm" is that of attenuation.
    notes : mapping of str to str, optional
        What was assumed to make it, such as {"support": "hull, 41 % of the voxels"}. Files keep it.

    Raises
    ------
    DataError
        If the shapes differ or a value is not finite.

    Examples
    --------
    >>> grid = pp.Grid((2, 2, 2), (1, 1, 1))
    >>> pp.Volume(np.full(grid.shape, 0.02), grid).unit
    '1/mm'
    """

    values: Float32
    grid: Grid
    unit: str = "1/mm"
    notes: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", float32("volume", self.values, self.grid.shape))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> AnyArray:
        return np.array(self.values, dtype=dtype) if copy else np.asarray(self.values, dtype=dtype)

    def _repr_html_(self) -> str:
        from palpate.volumes.volume_plots import volume_html  # only a notebook asks

        return volume_html(self)


def finite_volume(values: Float32, grid: Grid, notes: Mapping[str, str]) -> Volume:
    """A volume of float32 values that are known to be finite and of the grid's shape: no voxel is looked at."""
    made = object.__new__(Volume)
    for name, value in (("values", values), ("grid", grid), ("unit", "1/mm"), ("notes", notes)):
        object.__setattr__(made, name, value)
    return made


@dataclass(frozen=True, eq=False)
class Labels:
    """Labels of organs on a grid.

    Parameters
    ----------
    values : array_like, (z, y, x)
        One integer label for each voxel; 0 is outside.
    grid : Grid
        Where the voxels lie.
    names : mapping of int to str, optional
        Name of each label.

    Raises
    ------
    DataError
        If the shapes differ or the labels are not integers.

    Examples
    --------
    >>> labels.names
    {1: 'organ', 2: 'lump'}
    >>> labels.value_of("lump")
    2
    """

    values: Int32
    grid: Grid
    names: Mapping[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        values = as_numpy("labels", self.values)
        if values.shape != self.grid.shape:
            raise DataError(f"labels: expected shape {self.grid.shape} of their grid, got {values.shape}")
        if values.dtype.kind not in "iub" and not (values.dtype.kind == "f" and (values == np.round(values)).all()):
            raise DataError(f"labels: expected whole numbers, got dtype {values.dtype}; segment the volume first")
        object.__setattr__(self, "values", np.ascontiguousarray(values, dtype=np.int32))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> AnyArray:
        return np.array(self.values, dtype=dtype) if copy else np.asarray(self.values, dtype=dtype)

    def _repr_html_(self) -> str:
        from palpate.volumes.label_card import labels_html  # only a notebook asks

        return labels_html(self, self.names)

    def value_of(self, label: int | str) -> int:
        """Return the number of a label.

        Parameters
        ----------
        label : int or str
            Number or name.

        Returns
        -------
        int
            The label's number.

        Raises
        ------
        DataError
            If there is no such label. The message names the nearest.
        """
        present = [int(v) for v in np.unique(self.values) if v != 0]
        for value in present:
            if label == value or str(label) == str(value) or label == self.names.get(value):
                return value
        raise DataError(f"label {label!r} is absent; labels present: {self._nearest(str(label), present)}")

    def _nearest(self, wanted: str, present: list[int]) -> str:
        """The labels most like what was asked for first, then how many more there are: whole-body files hold 100."""

        def unlike(value: int) -> float:
            name = self.names.get(value, "")
            return -max(SequenceMatcher(None, wanted.lower(), t.lower()).ratio() for t in (name, str(value)))

        shown = [f"{v} ({self.names[v]})" if v in self.names else str(v) for v in sorted(present, key=unlike)[:SHOWN]]
        more = [f"and {len(present) - SHOWN} more"] if len(present) > SHOWN else []
        return ", ".join(shown + more) or "none: the mask is empty, segment the volume again or choose another file"
