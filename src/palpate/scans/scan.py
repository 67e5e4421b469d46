"""The scan: counts of the panel, open beam, background and geometry."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from palpate.arrays import AnyArray, ArrayLike, Bool, Float32, as_numpy, float32
from palpate.errors import DataError
from palpate.scans.blur import Blur
from palpate.scans.views import Views


@dataclass(frozen=True, eq=False, init=False)
class Scan:
    """Projections of an object, and all that is needed to interpret them.

    `scan[::2]` is the scan with every second view.

    Parameters
    ----------
    counts : array_like, (views, rows, columns)
        Photons; they need not be integers.
    incident : array_like
        Photons that a pixel would count with nothing in the beam: a scalar, (views,) or the shape of `counts`.
    views : Views
        The geometry.
    background : array_like, optional
        Expected scatter and dark counts, likewise.
    mask : array_like of bool, optional
        True where a pixel was measured, of a shape that broadcasts to `counts`. Other pixels are not
        used and may be NaN.
    notes : mapping of str to str, optional
        What was assumed to make it, such as the beam of estimated scatter. Files keep it.
    blur : Blur, optional
        Of the panel and the focal spot. The methods "map" and "ml" have it in their model.

    Raises
    ------
    DataError
        If shapes differ, a count is negative or not finite, or the blur is wider than the panel.

    Examples
    --------
    >>> counts = np.full((5, 40, 48), 900.0)
    >>> scan = pp.Scan(counts, incident=1000, views=views)
    >>> scan[::2].shape
    (3, 40, 48)
    """

    counts: Float32
    incident: Float32
    views: Views
    background: Float32
    mask: Bool
    notes: Mapping[str, str]
    blur: Blur | None

    def __init__(
        self,
        counts: ArrayLike,
        incident: ArrayLike,
        views: Views,
        background: ArrayLike = 0,
        mask: ArrayLike | None = None,
        notes: Mapping[str, str] | None = None,
        blur: Blur | None = None,
    ) -> None:
        measured = np.ones(views.shape, dtype=bool) if mask is None else as_numpy("mask", mask)
        if measured.dtype != bool:
            raise DataError(f"mask: expected dtype bool (True = measured), got {measured.dtype}")
        try:
            measured = np.ascontiguousarray(np.broadcast_to(measured, views.shape))
        except ValueError:
            raise DataError(f"mask: shape {measured.shape} does not broadcast to {views.shape}") from None
        if not measured.any():
            raise DataError("mask: no pixel is measured; True marks a measured pixel")
        y = float32("counts", _where_measured("counts", counts, measured), views.shape)
        b = per_pixel("incident", _where_measured("incident", incident, measured), views.shape)
        r = per_pixel("background", _where_measured("background", background, measured), views.shape)
        _raise_at("counts", y, (y < 0) & measured, "negative", "subtract no more than the offset, or mask them")
        _raise_at("background", r, (r < 0) & measured, "negative", "expected counts cannot be below 0")
        _raise_at("incident", b, (b <= 0) & measured, "0 or less", "mask dead pixels")
        for name, value in (("counts", y), ("incident", b), ("background", r), ("mask", measured)):
            value = value.view()
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        object.__setattr__(self, "views", views)
        object.__setattr__(self, "notes", dict(notes or {}))
        if blur is not None:
            blur.check(views)
        object.__setattr__(self, "blur", blur)

    def __getitem__(self, views: int | slice | list[int]) -> "Scan":
        """The same scan with some of its views."""
        k = np.atleast_1d(np.arange(len(self.views))[views])
        some, r = self.views[list(map(int, k))], self.background[k]
        return Scan(self.counts[k], self.incident[k], some, r, self.mask[k], self.notes, self.blur)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of (views, rows, columns)."""
        return self.views.shape

    def _repr_html_(self) -> str:
        from palpate.scans.scan_plots import scan_html  # only a notebook asks

        return scan_html(self)


def _where_measured(name: str, values: ArrayLike, measured: Bool) -> ArrayLike:
    """The values with 0 for what is not finite and was not measured."""
    array = as_numpy(name, values)
    if array.dtype.kind != "f" or array.shape != measured.shape or np.isfinite(array).all():
        return array
    return np.where(measured | np.isfinite(array), array, 0)


def per_pixel(name: str, values: ArrayLike, shape: tuple[int, int, int]) -> Float32:
    """A scalar, (views,) or full array as (views, rows, columns). Raises `DataError`."""
    array = float32(name, values)
    if array.shape == (shape[0],) and array.ndim == 1:
        array = array[:, None, None]
    try:
        return np.broadcast_to(array, shape)
    except ValueError:
        raise DataError(f"{name}: expected a scalar, ({shape[0]},) one a view, or {shape}; got {array.shape}") from None


def _raise_at(name: str, values: AnyArray, bad: Bool, what: str, remedy: str) -> None:
    if bad.any():
        view, row, column = (int(i) for i in np.argwhere(bad)[0])
        raise DataError(
            f"{name}: {np.count_nonzero(bad)} measured pixels are {what} (first at view {view}, row {row}, column "
            f"{column}: {values[view, row, column]:g}); {remedy}"
        )
