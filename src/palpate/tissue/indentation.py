"""Fits a tissue's stiffness to the force of an indenter."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import gamma
from scipy.stats import t as student

from palpate.arrays import ArrayLike, Float64, Int32, float64
from palpate.errors import DataError
from palpate.tissue.contact_patches import contacts
from palpate.tissue.indentation_curve import IndentationCurve
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.tissue import Tissue

# A patch of radius r with the pressure (1 - ρ²/r²)² on a half space moves by PATCH/(E* r) in the mean under 1 N, with
# E* = E/(1 - ν²): 1/π times the integral of the square of its Hankel transform 48 J₃(x)/x³. A flat punch of radius a moves
# by 1/(2 E* a).
PATCH = float(48**2 / np.pi * gamma(6) * gamma(0.5) / (2**6 * gamma(3.5) ** 2 * gamma(6.5)))
EDGES = 1.5  # of the mesh: patches of a smaller radius are not resolved
NORMAL_95 = 1.96  # half of a 95 % interval, in standard deviations
NEAR = 2.0  # such radii about a point: the surface whose curvature counts
STEPS = 7  # contact radii for which the tissue is asked


@dataclass(frozen=True, eq=False)
class IndentationFit:
    """What `fit_indentation` found.

    Parameters
    ----------
    young : float
        Young's modulus of the tissue where it is touched, kPa.
    interval : tuple of float
        Ends of the 95 % interval of `young`, kPa: noise of the curve alone.
    tissue : Tissue
        The tissue with that stiffness; its regions keep their ratio.
    onset : float
        Depth at which the indenter touches, mm.
    offset : float
        Force before that, N.
    depth, force, fitted : ndarray, (n,)
        The curve, mm and N, and what the model says of it, N.
    mesh_error : float
        Estimated error of the model's force that its mesh makes, relative; no part of the interval.
    resolved : float
        Share of the depth at which the contact was wide enough for the mesh; below, the half space was taken.

    Examples
    --------
    >>> curve = pp.IndentationCurve(np.linspace(0, 2, 9), np.linspace(0, 0.3, 9))
    >>> found = pp.fit_indentation(tissue, curve, top, punch=8)
    >>> found.interval[0] <= found.young <= found.interval[1]
    True
    """

    young: float
    interval: tuple[float, float]
    tissue: Tissue
    onset: float
    offset: float
    depth: Float64
    force: Float64
    fitted: Float64
    mesh_error: float
    resolved: float

    @property
    def misfit(self) -> float:
        """RMS of what is left, over the largest fitted force."""
        left = np.sqrt(np.mean((self.force - self.fitted) ** 2))
        return float(left / max(np.abs(self.fitted - self.offset).max(), 1e-300))

    @property
    def text(self) -> str:
        """What was found, in a sentence."""
        low, high = self.interval
        lines = [f"Young's modulus {self.young:.3g} kPa where it is touched (95 %: {low:.3g} to {high:.3g} kPa)"]
        lines.append(f"the model is {self.misfit:.1%} of the largest force off the curve (RMS)")
        lines.append(f"the mesh makes an error of some {abs(self.mesh_error):.0%}, which is not in the interval")
        if self.resolved < 1:
            lines.append(
                f"the first {1 - self.resolved:.0%} of the depth has a contact narrower than the mesh resolves"
            )
        return "; ".join(lines)


def fit_indentation(
    tissue: Tissue,
    curve: IndentationCurve,
    point: ArrayLike,
    *,
    sphere: float | None = None,
    punch: float | None = None,
    find_onset: bool = False,
) -> IndentationFit:
    """Fit a tissue's stiffness to the force of an indenter that is pressed in along the normal.

    The indenter is rigid and without friction, the tissue linearly elastic. A round indenter meets it on a circle that grows.
    Each step of its depth is that of a flat punch with the radius that the contact has then: √(d / (1/R + κ)), as for a
    sphere of radius R on a half space, with κ the mean curvature of the tissue's surface. Regions keep the ratio of their
    stiffness, and Poisson's ratio stays.

    Parameters
    ----------
    tissue : Tissue
        The organ, with a first guess of its stiffness.
    curve : IndentationCurve
        Depth, mm, and force, N.
    point : array_like, (3,)
        Where the indenter touches, mm.
    sphere : float, optional
        Radius of a round indenter, mm.
    punch : float, optional
        Radius of a flat cylinder, mm. Give this or `sphere`.
    find_onset : bool, optional
        Find where the curve begins to rise, and its force before that. Else depth and force count from the contact.

    Returns
    -------
    IndentationFit
        Young's modulus, with its interval.

    Raises
    ------
    DataError
        If the indenter is not one of them, the curve does not press in, or its force does not rise.

    References
    ----------
    Sneddon, Int. J. Eng. Sci. 3 (1965) 47; Johnson, Contact Mechanics, 1985, chapters 3 to 5.

    Examples
    --------
    >>> curve = pp.IndentationCurve(np.linspace(0, 2, 9), np.linspace(0, 0.3, 9))
    >>> pp.fit_indentation(tissue, curve, top, punch=8).young > 0
    True
    """
    if (sphere is None) == (punch is None):
        raise DataError("indenter: give the radius of a sphere or of a punch, mm, and not both")
    radius = sphere if sphere is not None else punch
    assert radius is not None
    if not (np.isfinite(radius) and radius > 0):
        raise DataError(f"indenter: a radius of {radius} mm; give more than 0, such as 4")
    if curve.depth.max() <= 0:
        raise DataError(
            f"indentation: the largest depth is {curve.depth.max():g} mm; depth is positive into the tissue"
        )
    deepest = float(curve.depth.max() - min(curve.depth.min(), 0.0))
    pressed = press(tissue, point, deepest, radius, sphere is not None)
    fit = fit_curve(curve, pressed.force, find_onset)
    touched = float(tissue.young[_tet_at(tissue, point)])
    ends = (touched * max(fit.factor - fit.half, 0.0), touched * (fit.factor + fit.half))
    curves = (fit.onset, fit.offset, curve.depth, curve.force, fit.fitted)
    found = stiffer(tissue, fit.factor).replace(young_spread=tissue.young * fit.half / NORMAL_95)
    return IndentationFit(touched * fit.factor, ends, found, *curves, pressed.mesh_error, pressed.resolved)


@dataclass(frozen=True)
class Pressed:
    """Force, N, of a tissue over an indenter's depth, mm; the mesh's error of it; the share of the depth that is resolved."""

    force: Callable[[Float64], Float64]
    mesh_error: float
    resolved: float


def press(tissue: Tissue, point: ArrayLike, deepest: float, radius: float, is_round: bool) -> Pressed:
    """The tissue under an indenter of `radius` mm, down to `deepest` mm."""
    if is_round:
        bend = 1 / radius + surface_curvature(tissue, point)
        if bend <= 0:
            raise DataError(
                f"indenter: a sphere of {radius:g} mm does not fit into the hollow where it touches; take a smaller one"
            )
        radius = 1 / bend
    widest = float(np.sqrt(radius * deepest)) if is_round else radius
    radii, stiffness, mesh_error = punch_stiffness(ComplianceModel(tissue), point, widest)
    narrow = _least_radius(tissue, point)
    if not is_round:
        return Pressed(lambda depth: stiffness[-1] * np.maximum(depth, 0.0), mesh_error, float(widest >= narrow))
    fine = np.linspace(0, deepest, 400)
    slope = np.interp(np.sqrt(radius * fine), radii, stiffness)
    summed = np.concatenate([[0], np.cumsum((slope[1:] + slope[:-1]) / 2 * np.diff(fine))])
    resolved = float(np.clip(1 - narrow**2 / (radius * deepest), 0, 1))
    return Pressed(lambda depth: np.interp(depth, fine, summed), mesh_error, resolved)


@dataclass(frozen=True, eq=False)
class CurveFit:
    """A force and how it is scaled to a curve: factor ± half is its 95 % interval. onset: mm. offset, fitted: N."""

    factor: float
    half: float
    onset: float
    offset: float
    fitted: Float64


def fit_curve(curve: IndentationCurve, force: Callable[[Float64], Float64], find_onset: bool = False) -> CurveFit:
    """Scales `force`, N, a function of the depth in mm, to a curve, by least squares.

    Raises `DataError` if the factor is not positive.
    """
    onset = _onset(curve, force) if find_onset else 0.0
    basis = np.column_stack([force(curve.depth - onset), *([np.ones(len(curve.depth))] if find_onset else [])])
    scale = np.linalg.lstsq(basis, curve.force, rcond=None)[0]
    if not scale[0] > 0:
        raise DataError("indentation: the force does not rise with the depth; is depth positive into the tissue?")
    fitted = basis @ scale
    if find_onset:  # the onset is a parameter, too
        step = 1e-4 * np.ptp(curve.depth)
        basis = np.column_stack([basis, scale[0] * (force(curve.depth - onset + step) - basis[:, 0]) / step])
    half = _half_width(basis, curve.force - fitted)
    return CurveFit(float(scale[0]), half, onset, float(scale[1]) if find_onset else 0.0, fitted)


def stiffer(tissue: Tissue, factor: float) -> Tissue:
    """The tissue with Young's modulus, and its springs, `factor` times as stiff everywhere."""
    springs = None if tissue.springs is None else replace(tissue.springs, scale=tissue.springs.scale * factor)
    return tissue.replace(young=tissue.young * factor, springs=springs, materials=None)


def surface_curvature(tissue: Tissue, point: ArrayLike) -> float:
    """1/mm: the mean of the surface's two curvatures at a point, positive where it is convex, by a paraboloid's fit."""
    hit = tissue.surface.closest(float64("point", point, (3,)))
    normal, at = np.asarray(tissue.surface.normal(hit)), np.asarray(hit.point)
    nodes = tissue.mesh.nodes[tissue.mesh.surface_nodes] - at
    near = nodes[np.linalg.norm(nodes, axis=1) < NEAR * 2 * PATCH * _least_radius(tissue, point)]
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    x, y, z = near @ first, near @ np.cross(normal, first), near @ normal
    basis = np.column_stack([x**2, y**2, x * y, x, y, np.ones(len(x))])
    if len(near) < basis.shape[1]:
        return 0.0
    found = np.linalg.lstsq(basis, z, rcond=None)[0]
    return float(-(found[0] + found[1]))


def _least_radius(tissue: Tissue, point: ArrayLike) -> float:
    """mm: of a punch whose patch is `EDGES` mean edges wide where it touches."""
    ends = tissue.mesh.nodes[tissue.edges[np.isin(tissue.edges, _touched(tissue, point)).any(axis=1)]]
    return float(EDGES * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean() / (2 * PATCH))


def _tet_at(tissue: Tissue, point: ArrayLike) -> int:
    """The tetrahedron behind the surface triangle nearest to a point."""
    return int(np.argmax(np.isin(tissue.mesh.tets, _touched(tissue, point)).sum(axis=1)))


def _touched(tissue: Tissue, point: ArrayLike) -> Int32:
    """(3,) nodes of the surface triangle nearest to a point."""
    return np.asarray(tissue.mesh.surface[tissue.surface.closest(float64("point", point, (3,))).triangle])


def punch_stiffness(exact: ComplianceModel, point: ArrayLike, widest: float) -> tuple[Float64, Float64, float]:
    """Radii from 0 to `widest`, mm, the stiffness N/mm of a flat punch of each, and the mesh's error at the widest.

    A punch is a contact patch with the radius that has its compliance on a half space, free to slide. Radii that the mesh
    does not resolve have a stiffness in proportion to them, as on a half space.
    """
    tissue, least = exact.tissue, _least_radius(exact.tissue, point)
    radii = np.linspace(min(least, widest), widest, STEPS) if widest > least else np.array([least])
    stiffness = []
    for radius in radii:
        found = contacts(tissue, point, (0.0, 0.0, 0.0), 2 * PATCH * radius, None, np.inf)
        hit = found.hits[0]
        normal = np.asarray(tissue.surface.normal(hit))
        stiffness.append(1 / float(normal @ exact.compliance(found) @ normal))
    answer = exact.push(point, -0.01 * normal, 2 * PATCH * radii[-1])
    assert answer.estimate is not None
    if widest <= least:
        return np.array([0.0, widest]), np.array([0.0, stiffness[0] * widest / least]), answer.estimate.mesh
    return np.concatenate([[0.0], radii]), np.concatenate([[0.0], stiffness]), answer.estimate.mesh


def _onset(curve: IndentationCurve, force: Callable[[Float64], Float64]) -> float:
    """mm: the depth from which the model, with a force before it, fits best."""

    def left(onset: float) -> float:
        basis = np.column_stack([force(curve.depth - onset), np.ones(len(curve.depth))])
        scale = np.linalg.lstsq(basis, curve.force, rcond=None)[0]
        return float(((curve.force - basis @ scale) ** 2).sum())

    tried = np.linspace(curve.depth.min(), curve.depth.min() + 0.8 * np.ptp(curve.depth), 60)
    best = int(np.argmin([left(onset) for onset in tried]))
    ends = tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)]
    return float(minimize_scalar(left, bounds=ends, method="bounded").x)


def _half_width(basis: Float64, residual: Float64) -> float:
    """Of the 95 % interval of the first coefficient. Where what is left is correlated along the curve, fewer points count."""
    n, unknown = basis.shape
    rho = float(np.clip((residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300), 0, 0.99))
    counted = max(n * (1 - rho) / (1 + rho), unknown + 1.0)
    variance = residual @ residual / (n - unknown) * n / counted
    covariance = np.linalg.pinv(basis.T @ basis) * variance
    return float(student.ppf(0.975, counted - unknown) * np.sqrt(covariance[0, 0]))
