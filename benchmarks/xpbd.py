"""XPBD (pyPBD): distances and volumes as compliant constraints, Gauss-Seidel over them (Macklin et al., MIG 2016)."""

import time
from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np
from scipy.sparse import coo_array

from benchmarks.cube_case import LAMBDA, MU, Cube
from benchmarks.settling_time import Run

NAME, MATERIAL = "XPBD, distances + volumes (pyPBD)", "springs"
MISSING = "XPBD is left out: pip install pyPBD"
LAW, EXACT = None, False
CHOICES = ((0.02, 20, True), (0.02, 5, True), (0.01, 1, False))  # step s, iterations, velocities set to zero


def there() -> bool:
    return find_spec("pypbd") is not None


def runs(cube: Cube) -> Iterator[Run]:
    """Each choice from the start. Units mm, kg, s: stress in kPa; gravity, which it always has, is then 1/1000."""
    import pypbd

    began = time.process_time()
    mesh = cube.tissue.mesh
    simulation = pypbd.Simulation.getCurrent()
    simulation.initDefault()
    model, stepper = simulation.getModel(), simulation.getTimeStep()
    particles, N = model.getParticles(), len(mesh.nodes)
    for x in mesh.nodes:
        particles.addVertex(x)
    for i in range(N):
        particles.setMass(i, 0.0 if cube.still[i] else float(cube.mass[i]))
    for (i, j), k in zip(cube.tissue.edges.tolist(), springs(cube).tolist(), strict=True):
        model.addDistanceConstraint_XPBD(i, j, k)
    for tet, volume in zip(mesh.tets.tolist(), mesh.volumes.tolist(), strict=True):
        model.addVolumeConstraint_XPBD(*tet, (LAMBDA - MU) / volume)
    model.initConstraintGroups()
    stepper.setValueUInt(pypbd.TimeStepController.NUM_SUB_STEPS, 1)
    now = np.asarray(particles.getVertices())
    setup = time.process_time() - began

    def stop() -> None:
        for i in range(N):
            particles.setVelocity(i, np.zeros(3))

    for seconds, iterations, quiet in CHOICES:
        stop()
        for i in range(N):
            particles.setPosition(i, cube.start[i])
        pypbd.TimeManager.getCurrent().setTimeStepSize(seconds)
        stepper.setValueUInt(pypbd.TimeStepController.MAX_ITERATIONS, iterations)
        yield Run(
            f"{1e3 * seconds:g} ms, {iterations} iterations" + (", velocities zeroed" if quiet else ""),
            setup,
            lambda: stepper.step(model),
            lambda: now - mesh.nodes,
            stop if quiet else lambda: None,
        )


def springs(cube: Cube) -> np.ndarray:
    """(E,) N/m: k = 5/2 μ Σ V/l² over the tets of an edge, a solid with λ = μ in the mean; volumes add λ − μ.

    Such a k is Van Gelder's for a solid of E = 5/2 μ (J. Graph. Tools 3, 1998, 21).
    """
    mesh, edges = cube.tissue.mesh, cube.tissue.edges
    pairs = [np.sort(mesh.tets[:, [a, b]], axis=1) for a in range(4) for b in range(a + 1, 4)]
    ends = np.concatenate(pairs)
    around = coo_array((np.tile(mesh.volumes, 6), (ends[:, 0], ends[:, 1])), shape=(len(mesh.nodes),) * 2).tocsr()
    length = np.linalg.norm(mesh.nodes[edges[:, 0]] - mesh.nodes[edges[:, 1]], axis=1)
    return np.asarray(2.5 * MU * around[edges[:, 0], edges[:, 1]] / length**2)
