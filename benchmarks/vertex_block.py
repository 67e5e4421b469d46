"""Vertex block descent (newton's SolverVBD on the CPU, float32): Chen et al., ACM Trans. Graph. 43 (2024) 116."""

import time
from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np

from benchmarks.cube_case import DENSITY, LAMBDA, MU, STABLE, Cube
from benchmarks.settling_time import Run

NAME, MATERIAL = "vertex block descent (newton)", "stable neo-Hookean"
MISSING = "Vertex block descent is left out: pip install newton warp-lang"
LAW, EXACT = STABLE, True  # it was seen to come within 0.02 % of that at 11³
CHOICES = ((1.0, 1, True), (0.02, 10, True))  # step s, iterations, velocities set to zero


def there() -> bool:
    return find_spec("newton") is not None and find_spec("warp") is not None


def runs(cube: Cube) -> Iterator[Run]:
    """Each choice from the start; kernels are compiled before."""
    import warp

    warp.config.log_level = warp.LOG_ERROR
    import newton

    began = time.process_time()
    mesh = cube.tissue.mesh
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.add_soft_mesh(
        pos=warp.vec3(0, 0, 0),
        rot=warp.quat_identity(),
        scale=1.0,
        vel=warp.vec3(0, 0, 0),
        vertices=[warp.vec3(*x) for x in mesh.nodes],
        indices=mesh.tets.ravel().tolist(),
        density=DENSITY,
        k_mu=MU,
        k_lambda=LAMBDA,
        k_damp=0.0,
        add_surface_mesh_edges=False,
    )
    for i in np.flatnonzero(cube.still):
        builder.particle_mass[i] = 0.0
        builder.particle_flags[i] &= ~newton.ParticleFlags.ACTIVE
    builder.color()
    model = builder.finalize(device="cpu")
    setup = time.process_time() - began
    for seconds, iterations, quiet in CHOICES:
        yield _run(newton, model, cube, seconds, iterations, quiet, setup)


def _run(newton, model, cube: Cube, seconds: float, iterations: int, quiet: bool, setup: float) -> Run:
    solver = newton.solvers.SolverVBD(model, iterations=iterations, particle_enable_self_contact=False)
    states, control = [model.state(), model.state()], model.control()
    solver.step(*states, control, None, seconds)  # compiles what is missing
    for state in states:
        state.particle_q.assign(cube.start.astype(np.float32))
        state.particle_qd.zero_()

    def step() -> None:
        solver.step(*states, control, None, seconds)
        states.reverse()

    return Run(
        f"{1e3 * seconds:g} ms, {iterations} iterations" + (", velocities zeroed" if quiet else ""),
        setup,
        step,
        lambda: states[0].particle_q.numpy().astype(np.float64) - cube.tissue.mesh.nodes,
        lambda: states[0].particle_qd.zero_() if quiet else None,
    )
