"""What no scan of an unknown object can tell of its geometry: changes of the views that a change of the object undoes."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import DataError
from palpate.scans.view_parameters import poses, shadow_slopes, shadows
from palpate.scans.views import Views

CHOSEN = {"shifts": (3, 4), "sources": (0, 1, 2), "poses": tuple(range(9))}  # of PARAMETERS
STEP = 1e-3  # mm
CLEAR = 0.3  # of a change: a part of a kind that is smaller does not name it
KINDS = (
    ("displacement", slice(0, 3)),
    ("rotation", slice(3, 6)),
    ("scale", slice(6, 7)),
    ("affine change", slice(7, 12)),
    ("projective change", slice(12, 15)),
)


@dataclass(frozen=True, eq=False)
class Gauge:
    """Changes of the geometry that an unknown object hides.

    Parameters
    ----------
    directions : ndarray, (n, views, parameters)
        Each moves the shadows by 1 pixel (RMS) if the object stays as it is; mm and degrees. Parameters are (dv, du) of the
        panel for `moves="shifts"`.
    left : ndarray, (n,)
        Pixels (RMS) by which the shadows still differ once the object has changed too; 0 for an exact gauge.
    words : tuple of str
        What the object does: displacement, rotation, scale, affine or projective change.

    Examples
    --------
    >>> gauge = pp.Gauge(np.zeros((1, 5, 2)), np.zeros(1), ("displacement of the object along x",))
    >>> len(gauge.words)
    1
    """

    directions: Float64
    left: Float64
    words: tuple[str, ...]


def calibration_gauge(
    views: Views,
    points: ArrayLike,
    *,
    moves: Literal["shifts", "sources", "poses"] = "shifts",
    tolerance: float = 0.1,
) -> Gauge:
    """Return the changes of the views that a change of the object would hide, from the null space of the Jacobian.

    Every point of the object may move. What is left of the shadows' motion by the views, after the best motion of the
    points, is what data can tell.

    Parameters
    ----------
    views : Views
        The geometry.
    points : array_like, (N, 3)
        Points that fill the object (x, y, z), mm; some tens, not in one plane.
    moves : {"shifts", "sources", "poses"}, optional
        What is unknown of each view: the panel's shift in its plane, the focal spot, or both and the panel's tilts.
    tolerance : float, optional
        Largest share of the shadows' motion that may be left.

    Returns
    -------
    Gauge
        A basis of these changes, and their names.

    Raises
    ------
    DataError
        If there are fewer than 6 points or they lie in one plane.

    References
    ----------
    Triggs, McLauchlan, Hartley and Fitzgibbon, Bundle adjustment: a modern synthesis, 2000, section 9.

    Examples
    --------
    >>> points = np.random.default_rng(1).uniform(-20, 20, (30, 3)) + (0, 0, 24)
    >>> for words in pp.calibration_gauge(views, points).words:
    ...     print(words.split(",")[0])
    displacement of the object along x
    displacement of the object along y
    displacement of the object along z
    """
    X = float64("points", points, (None, 3))
    centred = X - X.mean(axis=0)
    extent = np.linalg.svd(centred, compute_uv=False)
    if len(X) < 6 or extent[2] < 1e-3 * extent[0]:
        raise DataError(
            f"points: expected 6 or more that are not in one plane, got {len(X)}; fill the object with them"
        )
    if moves not in CHOSEN:
        raise DataError(f"moves: expected one of {', '.join(CHOSEN)}, got {moves!r}")
    at = poses(views)
    k, n = len(views), len(X)
    own = shadow_slopes(at, X, np.zeros((k, 9)))[..., list(CHOSEN[moves])]
    p = own.shape[-1]
    by_view = np.zeros((n, k, 2, k, p))
    for v in range(k):
        by_view[:, v, :, v] = own[v]
    J = by_view.reshape(n, 2 * k, k * p)
    steps = STEP * np.eye(3)
    by_point = np.stack([(shadows(at, X + s) - shadows(at, X - s)) / (2 * STEP) for s in steps], axis=-1)
    A = by_point.transpose(1, 0, 2, 3).reshape(n, 2 * k, 3)
    answer = -np.linalg.pinv(A) @ J  # (n, 3, k p): how the points go with the views
    rest = J + A @ answer
    # Whitened: directions of unit length move the shadows by 1 pixel RMS
    power, turn = np.linalg.eigh(np.einsum("nai,naj->ij", J, J) / (n * k))
    able = power > 1e-12 * power[-1]
    white = turn[:, able] / np.sqrt(power[able])
    left, basis = np.linalg.eigh(white.T @ (np.einsum("nai,naj->ij", rest, rest) / (n * k)) @ white)
    hidden = left <= tolerance**2
    chosen = white @ basis[:, hidden]
    if not hidden.any():
        return Gauge(np.zeros((0, k, p)), np.zeros(0), ())
    fields, scale = np.linalg.qr(np.einsum("nci,ij->ncj", answer, chosen).reshape(3 * n, -1))
    turned, words = _named(fields, centred)
    directions = (chosen @ np.linalg.solve(scale, turned)).T
    directions /= np.sqrt((np.einsum("nai,ji->jna", J, directions) ** 2).sum(axis=(1, 2)) / (n * k))[:, None]
    remains = np.sqrt((np.einsum("nai,ji->jna", rest, directions) ** 2).sum(axis=(1, 2)) / (n * k))
    return Gauge(directions.reshape(-1, k, p), remains, tuple(words))


def _generators(points: Float64) -> Float64:
    """(3N, 15): fields of displacements, rotations, scale, other affine and projective changes, each of unit length."""
    x, y, z = (points / np.abs(points).max()).T
    o, i = np.zeros_like(x), np.ones_like(x)
    fields = [(i, o, o), (o, i, o), (o, o, i)]
    fields += [(o, -z, y), (z, o, -x), (-y, x, o), (x, y, z)]
    fields += [(x, -y, o), (-x, -y, 2 * z), (y, x, o), (z, o, x), (o, z, y)]
    fields += [(x * w, y * w, z * w) for w in (x, y, z)]
    columns = np.stack([np.stack(f, axis=1).ravel() for f in fields], axis=1)
    return np.asarray(columns / np.linalg.norm(columns, axis=0))


def _named(fields: Float64, points: Float64) -> tuple[Float64, list[str]]:
    """A rotation (n, n) of an orthonormal basis of fields (3N, n) that sorts it by kind of change, and words for each."""
    generators = _generators(points)
    share = np.linalg.lstsq(generators, fields, rcond=None)[0]
    left, columns, words = np.eye(fields.shape[1]), [], []
    for kind, rows in KINDS:
        if not left.shape[1]:
            break
        U, s, V = np.linalg.svd(share[rows] @ left)
        count = int(np.count_nonzero(s > CLEAR))
        part = left @ V[:count].T
        if kind in ("displacement", "rotation") and count == 3:  # any three span all: say x, y and z
            Q, _ = np.linalg.qr(np.linalg.inv(share[rows] @ part))
            part, U = part @ Q * np.sign(np.diag(share[rows] @ part @ Q)), np.eye(3)
        for j in range(count):
            columns.append(part[:, j])
            words.append(_words(kind, U[:, j], fields @ part[:, j], generators))
        left = left @ V[count:].T
    columns += list(left.T)
    words += ["another change of the object's shape"] * left.shape[1]
    return np.array(columns).reshape(-1, fields.shape[1]).T, words


def _words(kind: str, way: Float64, field: Float64, generators: Float64) -> str:
    text = f"{kind} of the object"
    if kind in ("displacement", "rotation"):
        large = int(np.argmax(np.abs(way)))
        axis = "xyz"[large] if abs(way[large]) > 0.95 else "(" + ", ".join(f"{v:.2f}" for v in way) + ")"
        text += f" {'along' if kind == 'displacement' else 'about'} {axis}"
    last = next(rows.stop for name, rows in KINDS if name == kind)
    for name, rows in KINDS:  # the smallest group of changes that holds it
        some = generators[:, : rows.stop]
        rest = field - some @ np.linalg.lstsq(some, field, rcond=None)[0]
        if rows.stop >= last and rest @ rest < 0.01 * field @ field:
            return text + (f", with a {name}".replace("a affine", "an affine") if rows.stop > last else "")
    return text + ", with another change of its shape"
