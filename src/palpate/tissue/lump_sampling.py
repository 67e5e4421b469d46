"""Carries the samples of a posterior through a lump's outline and its stiffness to the force that a hand feels."""

from collections.abc import Callable, Mapping

import numpy as np

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import DataError
from palpate.reconstruction.posterior import Posterior
from palpate.tissue.interval_correction import IntervalCorrection
from palpate.tissue.lump_outline import Rule, centre_of_mass, contrast_weights, outlines, tet_shares
from palpate.tissue.lump_uncertainty import LumpUncertainty
from palpate.tissue.spring_fitting import surface_normals
from palpate.tissue.stiffness_draws import Stiffness, in_series, latin_normals, log_normal
from palpate.tissue.stiffness_update import StiffnessUpdate
from palpate.tissue.tissue import Tissue

LEAST_SHARE = 0.02  # of a tetrahedron, below which it counts as free of the lump
LEAST = 1e-5  # share of the force below which an added force counts as this, so that it has a logarithm


def lump_uncertainty(
    found: Posterior,
    tissue: Tissue,
    *,
    lump: Stiffness,
    body: Stiffness | None = None,
    near: ArrayLike | None = None,
    rule: Rule | None = None,
    point: ArrayLike | None = None,
    push: float = 5.0,
    radius: float = 8.0,
    places: ArrayLike | None = None,
    draws: int = 1,
    seed: int = 0,
    corrections: Mapping[str, IntervalCorrection] | None = None,
    progress: Callable[[float], None] | None = None,
) -> LumpUncertainty:
    """Carry the doubt of a reconstruction to the hand: a lump's size, depth and contrast, and the force that it adds.

    Every sample of the posterior is segmented by one rule. Its lump stiffens the tetrahedra by the share of them that it
    fills (compliances add up), with a stiffness drawn from its range for each sample, and the force of a push over the
    lump follows by finite elements. The outline of the body is that of the tissue in all samples.

    Parameters
    ----------
    found : Posterior
        The samples.
    tissue : Tissue
        The body without the lump, in the frame of the volume. A mesh as fine as a third of the lump is fine enough.
    lump, body : Measured or (float, float)
        Young's modulus: mean and standard deviation, kPa, of a log-normal distribution. The body's scales that of
        `tissue` as a whole; by default it is certain.
    near : array_like, (3,), optional
        The lump's place (x, y, z), mm, for the default rule: the ball whose circles have the steepest mean radial
        gradient, within 5 mm across, and in all depths for the MAP estimate.
    rule : callable, optional
        Given a volume, returns the share of each voxel that is lump, (z, y, x), 0 to 1; a mask will do.
    point : array_like, (3,), optional
        Where the hand pushes, mm. By default the free surface's point nearest to the lump.
    push, radius : float, optional
        Depth of the push and radius of the contact, mm.
    places : array_like, (P, 3), optional
        Other places for the force map and its band, mm.
    draws : int, optional
        Of the stiffness for each sample.
    seed : int, optional
        Of the draws.
    corrections : mapping of str to IntervalCorrection, optional
        Learnt on other bodies, by quantity.
    progress : callable, optional
        Called with the share done.

    Returns
    -------
    LumpUncertainty
        Samples of each quantity; `text()` is the verdict.

    Raises
    ------
    DataError, MaterialError
        If the samples were not kept, an argument is not valid, or a sample has no lump.

    References
    ----------
    Stein, Technometrics 29:143, 1987: Latin hypercube samples, of the stiffness here.

    Examples
    --------
    >>> found = pp.posterior(scan, grid, samples=9, levels=1)
    >>> doubt = pp.lump_uncertainty(found, tissue, lump=(50, 10), body=(5, 1), near=(0, 0, 27), radius=10)
    >>> print(doubt.text(level=0.8).splitlines()[0][:38])
    a hand feels the lump with a probabili
    """
    if found.samples is None:
        raise DataError("lump_uncertainty: the samples were not kept; give keep=True to posterior")
    if draws < 1 or not (push > 0 and radius > 0):
        raise DataError(f"draws, push, radius: expected numbers above 0, got {draws}, {push} and {radius}")
    spread_lump, spread_body = log_normal("lump", lump), log_normal("body", body or (1.0, 0.0))
    grid = found.map.grid
    shapes = outlines(found, near, rule)
    volume = np.array([float(s.sum()) for s in shapes]) * grid.voxel_volume
    centres = np.array([centre_of_mass(s, grid) for s in shapes])
    at = _over(tissue, centres[0], radius) if point is None else float64("point", point, (3,))
    others = np.zeros((0, 3)) if places is None else float64("places", places, (None, 3))
    normal = surface_normals(tissue, at[None])[0]
    weights = contrast_weights(shapes[0])
    filled = [tet_shares(tissue.mesh, s, grid) for s in shapes[1:]]
    changed = np.max(filled, axis=0) > LEAST_SHARE
    update = StiffnessUpdate(tissue, changed, np.concatenate([at[None], others]), radius)
    z = latin_normals(draws * len(filled), 2, seed)
    young = np.exp(spread_lump[0] + spread_lump[1] * z[:, 0])
    scale = np.exp(spread_body[1] * z[:, 1] - spread_body[1] ** 2 / 2)
    forces = np.empty((len(young), 1 + len(others)))
    for k, (stiff, factor) in enumerate(zip(young, scale, strict=True)):
        mixed = in_series(tissue.young, stiff / factor, np.where(changed, filled[k // draws], 0))
        forces[k] = factor * update.forces(mixed, push)
        if progress:
            progress((k + 1) / len(young))
    plain = scale[:, None] * update.plain_forces(push)
    return LumpUncertainty(
        tissue,
        at,
        normal,
        np.cbrt(6 * volume[1:] / np.pi),
        (at - centres[1:]) @ normal,
        np.einsum("kzyx,zyx->k", found.samples, weights, dtype=np.float64),
        weights,
        plain[:, 0],
        np.maximum(forces[:, 0] - plain[:, 0], LEAST * plain[:, 0]),
        others,
        forces[:, 1:],
        plain[:, 1:],
        push,
        radius,
        dict(corrections or {}),
    )


def _over(tissue: Tissue, centre: Float64, radius: float) -> Float64:
    """(3,) mm: the surface node nearest to a place, among those farther than a radius from what is held, if there are."""
    surface = tissue.mesh.surface_nodes
    x = tissue.mesh.nodes[surface]
    held = tissue.mesh.nodes[tissue.held]
    away = (
        np.array([float(np.linalg.norm(held - p, axis=1).min()) for p in x]) if len(held) else np.full(len(x), np.inf)
    )
    x = x[away > min(radius, float(away.max()) / 2)]
    return np.asarray(x[np.argmin(np.linalg.norm(x - centre, axis=1))])
