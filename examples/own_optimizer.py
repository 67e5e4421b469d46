"""An optimizer of your own in one file: python examples/own_optimizer.py

It is the spectral projected gradient method (Birgin, Martinez & Raydan, SIAM J. Optim. 10:1196, 2000), scaled by a
diagonal. Its objective may rise for some iterations, which no built-in optimizer lets it do. For the command:

    palpate --plugin examples/own_optimizer.py reconstruct scan.h5 -o volume.nii.gz --optimizer spectral-gradient
"""

import numpy as np

import palpate as pp

MEMORY = 5  # objectives that an iterate may not exceed: the highest of so many
DECREASE = 1e-4  # share of the decrease that the slope promises (Armijo)


@pp.register_optimizer("spectral-gradient")
class SpectralGradient:
    """Steps along the projected gradient, as long as the last change of the gradient suggests (Barzilai & Borwein)."""

    def __init__(self, problem, values, state):
        self.problem, self.f = problem, values
        A, likelihood = problem.A, problem.likelihood
        weights = likelihood.curvature(np.zeros(A.range_shape, np.float32), "precomputed")
        scale = A.T(weights * A(np.ones(A.domain_shape, np.float32)))  # a diagonal above the data's second derivative
        self.scale = np.maximum(scale, 1e-6 * scale.max())
        self.gradient = problem.gradient(values)
        self.step = float(state.get("step", 1.0))
        self.history = list(state.get("history", [problem.objective(values)]))

    def update(self):
        """The next iterate and its objective."""
        f, slope = self.f, self.gradient
        way = np.maximum(f - np.float32(self.step) * slope / self.scale, 0) - f
        descent, share = np.vdot(slope.astype(np.float64), way), np.float32(1)
        while True:
            following = f + share * way
            objective = self.problem.objective(following)
            if objective <= max(self.history[-MEMORY:]) + DECREASE * share * descent or share < 1e-6:
                break
            share /= 2
        self.f, self.gradient = following, self.problem.gradient(following)
        moved, bend = (following - f).astype(np.float64), (self.gradient - slope).astype(np.float64)
        curvature = np.vdot(moved, bend)
        self.step = float(np.clip(np.vdot(moved, self.scale * moved) / curvature, 1e-3, 1e3)) if curvature > 0 else 1e3
        self.history = [*self.history[-MEMORY:], objective]
        return following, objective

    def state(self):
        """The iterate is kept by palpate, and the gradient follows from it."""
        return {"step": np.array(self.step), "history": np.array(self.history)}


def main():
    """Gives the objective that this optimizer and a built-in one reach, by name."""
    body = pp.Phantom([(pp.Ellipsoid((0, 0, 24), (17, 13, 8)), 0.02), (pp.Ellipsoid((5, 2, 24), 4), 0.04)])
    views = pp.arc_views(pp.Panel((44, 60), (1, 1), (-29.5, -21.5, 0)), np.linspace(-25, 25, 7), radius=500)
    scan = pp.simulate_scan(body, views, incident=20_000, seed=1)
    grid = pp.Grid((10, 32, 40), (2, 1, 1), (-19.5, -15.5, 15))
    reached = {}
    for name in ("momentum", "spectral-gradient"):
        *_, last = pp.iterates(scan, grid, levels=1, optimizer=name, iterations=300, tolerance=1e-8)
        reached[name] = last.objective
    return reached


if __name__ == "__main__":
    for name, objective in main().items():
        print(f"{name}: objective {objective:.6g}")
