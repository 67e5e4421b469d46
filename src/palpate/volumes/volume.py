"""What voxels hold: attenuation, or labels."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from typing import Any

import numpy as np

from palpate.arrays import AnyArray, Float32, Int32, float32
from palpate.errors import DataError
from palpate.volumes.grid import Grid

SHOWN = 6  # labels that a message names


@dataclass(frozen=True, eq=False)
class Volume:
    """values: (z, y, x) float32 on `grid`, attenuation in 1/mm unless `unit` says otherwise. Raises `DataError`."""

    values: Float32
    grid: Grid
    unit: str = "1/mm"

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", float32("volume", self.values, self.grid.shape))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> AnyArray:
        return np.array(self.values, dtype=dtype) if copy else np.asarray(self.values, dtype=dtype)

    def _repr_html_(self) -> str:
        from palpate.volumes.plots import volume_html  # only a notebook asks

        return volume_html(self)


@dataclass(frozen=True, eq=False)
class Labels:
    """values: (z, y, x) int32 on `grid`, 0 is outside; names: label value to name. Raises `DataError`."""

    values: Int32
    grid: Grid
    names: Mapping[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        values = np.asarray(self.values)
        if values.shape != self.grid.shape:
            raise DataError(f"labels: expected shape {self.grid.shape} of their grid, got {values.shape}")
        if values.dtype.kind not in "iub" and not (values.dtype.kind == "f" and (values == np.round(values)).all()):
            raise DataError(f"labels: expected whole numbers, got dtype {values.dtype}; segment the volume first")
        object.__setattr__(self, "values", np.ascontiguousarray(values, dtype=np.int32))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> AnyArray:
        return np.array(self.values, dtype=dtype) if copy else np.asarray(self.values, dtype=dtype)

    def value_of(self, label: int | str) -> int:
        """The number of a label given by number or name; a `DataError` names the nearest that there are."""
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
