"""A body with mass, by all modes of its dense matrices: the truth of tests and benchmarks of inertia."""

import numpy as np
from scipy.linalg import eigh

from palpate.tissue.contact_patches import patch
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.vibration import nodal_mass

TICK = 1e-3  # s


def smooth(t, over):
    """From 0 to 1 with no kick at its ends."""
    x = np.clip(t / over, 0, 1)
    return x * x * (3 - 2 * x)


class AllModes:
    """Every mode of the free nodes, with the tissue's relaxation, by the implicit Euler method in 32 steps a tick."""

    def __init__(self, tissue, radius, substeps=32):
        elements = FiniteElements(tissue, "smoothed")
        self.free, self.tissue, self.radius, self.h = elements.free, tissue, radius, TICK / substeps
        self.substeps = substeps
        K = elements.K[self.free][:, self.free].toarray()
        mass = nodal_mass(tissue.mesh, tissue.inertia.density)[~tissue.held].repeat(3)
        square, self.shapes = eigh(K, np.diag(mass))
        self.omega = np.sqrt(square)
        self.damping = 2 * tissue.inertia.damping * self.omega
        self.eta, self.rate = np.zeros(len(self.omega)), np.zeros(len(self.omega))
        series = tissue.relaxation
        shares, times = (np.empty(0), np.empty(0)) if series is None else series.table().T
        self.ratio = shares * (1 if series is None else series.instantaneous)
        self.kept = 1 / (1 + self.h / times)
        self.branch = np.zeros((len(times), len(self.omega)))

    def weights(self, at):
        W = np.zeros((3 * len(self.tissue.mesh.nodes), 3))
        one = patch(self.tissue, at, self.radius)
        for node, w in zip(one.nodes, one.weights, strict=True):
            W[3 * node + np.arange(3), np.arange(3)] = w
        return self.shapes.T @ W[self.free]

    def tick(self, at=None, before=None, after=None):
        """The mean force of the tissue on the tool that goes from one displacement to another, evenly."""
        h, total = self.h, np.zeros(3)
        P = None if at is None else self.weights(at)
        square = self.omega**2
        stiffer = 1 + (self.kept * self.ratio).sum()
        scale = 1 / (1 + h * self.damping + h * h * stiffer * square)
        for s in range(1, self.substeps + 1):
            there = self.eta + h * self.rate
            pull = self.kept @ self.branch + (stiffer - 1) * square * h * self.rate
            rest = scale * (-self.damping * self.rate - square * there - pull)  # acceleration without a load
            if P is not None:
                d = before + (after - before) * s / self.substeps
                force = np.linalg.solve(h * h * (P.T * scale) @ P, d - P.T @ (there + h * h * rest))
                rest = rest + scale * (P @ force)
                total -= force / self.substeps
            moved = h * (self.rate + h * rest)
            self.branch = self.kept[:, None] * (self.branch + self.ratio[:, None] * square * moved)
            self.eta, self.rate = self.eta + moved, self.rate + h * rest
        return total

    def whole(self):
        out = np.zeros(3 * len(self.tissue.mesh.nodes))
        out[self.free] = self.shapes @ self.eta
        return out.reshape(-1, 3)
