"""Settings of a session's ticks, made of arguments that are checked first."""

from collections.abc import Mapping

import numpy as np

from palpate import _core
from palpate.errors import DataError, MaterialError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.tissue.cutting_work import toughness_by_region
from palpate.tissue.models.registry import name_of
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.tissue import Tissue

TICK_BUDGET = 0.4e-3  # s of each tick for sweeps
MOST_SWEEPS = 40


def simulation_settings(
    tissue: Tissue,
    radius: float | None,
    limit: float,
    friction: float,
    toughness: float | Mapping[int | str, float] | None,
    blade_friction: float,
) -> _core.simulation.SimulationSettings:
    """The core's settings for arguments of `Session`, without the sweeps. Raises `DataError`."""
    radius = default_radius(tissue) if radius is None else float(radius)
    for name, value in (("radius", radius), ("limit", limit)):
        if not value > 0 or not np.isfinite(value):
            raise DataError(f"{name}: {value:g}, expected more than 0; leave it out for the default")
    if not friction >= 0 or not np.isfinite(friction):
        raise DataError(f"friction: {friction:g}, expected 0 or more; leave it out for the default")
    settings = _core.simulation.SimulationSettings()
    settings.radius, settings.limit, settings.friction = radius, float(limit), float(friction)
    settings.resistance, settings.blade_friction = cut_resistance(tissue, toughness), blade_friction
    return settings


def cut_resistance(
    tissue: Tissue, toughness: float | Mapping[int | str, float] | None
) -> _core.simulation.CutResistance:
    """What a blade feels in the tissue before all its cuts, without the pieces that these have taken away.

    Raises `MaterialError`, as `cutting_work` does.
    """
    mesh, (tough, _) = tissue.mesh, toughness_by_region(tissue, toughness)
    if not isinstance(mesh, CutMesh):
        return _core.simulation.CutResistance(mesh.nodes, mesh.tets, mesh.region, tough)
    first = np.unique(mesh.parent, return_index=True)[1]  # copies of a tetrahedron have its places
    return _core.simulation.CutResistance(mesh.nodes, mesh.tets[first], mesh.region[first], tough)


def default_radius(tissue: Tissue) -> float:
    """Two mean edges of the surface, mm; of a cut tissue, whose surface goes through elements, those of all edges."""
    mesh = tissue.mesh
    if isinstance(mesh, CutMesh):
        return 2 * tissue.edge
    corner = mesh.nodes[mesh.surface]
    return 2 * float(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).mean())


def sweep_seconds(model: TissueModel, radius: float) -> float:
    """Seconds of one sweep of the model on this machine."""
    return _core.simulation.sweep_seconds(model.native, model.tissue.surface, radius)


def sweeps_in_tick(seconds: float, asked: int | None = None) -> int:
    """As many as were asked for, or as fit a tick if each takes so many seconds. Raises `DataError`."""
    if asked is None:
        return max(1, min(MOST_SWEEPS, int(TICK_BUDGET / seconds)))
    if not 0 < asked <= 10_000:
        raise DataError(f"sweeps: {asked}, expected 1 to 10000; leave it out to have it measured")
    return int(asked)


def require_time_dependence(model: TissueModel) -> None:
    """Raises `MaterialError` if the tissue relaxes or has inertia, and the model does not follow."""
    tissue = model.tissue
    if tissue.time_dependent and not model.time_dependent:
        what = "relaxation" if tissue.inertia is None else "inertia"
        raise MaterialError(
            f"model: {name_of(model)} does not follow the tissue's {what}; take compliance, or fit without --{what}"
        )
