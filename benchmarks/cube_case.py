"""The cube that deformation is measured on, and what finite elements say of it.

50 mm, held at its bottom, six tetrahedra a cell, E = 10 kPa, ν = 0.3. The contact is ours: a smooth patch of radius two mean
edges in the middle of the top, its weighted mean displacement 5 mm inwards. Most peers can only prescribe nodes: they are
given the patch's nodes where linear elements move them, so that all have one contact, and linear elements one answer.
"""

import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.sparse.linalg import splu

import palpate as pp
from palpate.arrays import Bool, Float64, Int32
from palpate.tissue.contact_patches import Contacts, contacts
from palpate.tissue.reference.finite_strain import FiniteStrain, Law
from palpate.tissue.reference.linear_elasticity import FiniteElements, lame
from palpate.tissue.sparse_factor import Factors

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.brick_meshes import brick
from support.vibrating_body import AllModes as AllModes
from support.vibrating_body import smooth as smooth

TOP, PUSH = np.array([25.0, 25.0, 50.0]), np.array([0.0, 0.0, -5.0])
YOUNG, POISSON, DENSITY = 10.0, 0.3, 1e-6  # kPa, no unit, kg/mm³
LAMBDA, MU = (1e3 * float(c) for c in lame(YOUNG, POISSON))  # kPa


@dataclass(frozen=True)
class Cube:
    """tissue: of n³ nodes. truth: (N, 3) mm, linear P1 elements under the smooth contact."""

    n: int
    tissue: pp.Tissue
    truth: Float64

    @property
    def radius(self) -> float:
        return 2 * self.tissue.edge

    @cached_property
    def contact(self) -> Contacts:
        return contacts(self.tissue, TOP, PUSH, self.radius)

    @property
    def touched(self) -> Int32:
        return np.asarray(self.contact.patches[0].nodes)

    @cached_property
    def still(self) -> Bool:
        """(N,) True where a peer moves no node: held, or touched."""
        mask = self.tissue.held.copy()
        mask[self.touched] = True
        return mask

    @cached_property
    def start(self) -> Float64:
        """(N, 3) mm, where a peer starts: at rest, but the touched nodes in place."""
        x = self.tissue.mesh.nodes.copy()
        x[self.touched] += self.truth[self.touched]
        return x

    @cached_property
    def mass(self) -> Float64:
        """(N,) kg, a quarter of each tet's."""
        mesh = self.tissue.mesh
        return np.bincount(mesh.tets.ravel(), np.repeat(mesh.volumes * DENSITY / 4, 4))

    def off(self, u: Float64, other: Float64) -> float:
        """How far displacement u (N, 3) is from another, relative to it, by the root mean square."""
        return float(np.linalg.norm(u - other) / np.linalg.norm(other))

    def settled(self, law: Law) -> Float64 | None:
        """(N, 3) mm: P1 elements of that material with the peers' contact, by Newton's method from the linear answer.

        None if it does not converge.
        """
        solver, free = FiniteStrain(self.tissue, "P1", law), np.flatnonzero(np.repeat(~self.still, 3))
        u = self.truth.ravel().copy()
        for _ in range(25):
            force = solver.force(u)
            if np.abs(force[free]).max() < 1e-9 * np.abs(force).max():
                return u.reshape(-1, 3)
            K = solver.tangent(u)[free][:, free]
            factors = Factors(K, self.tissue.mesh.nodes[~self.still])
            change = factors.solve(-force[free]) if factors.positive else splu(K.tocsc()).solve(-force[free])
            part = 1.0
            while True:  # no element may turn inside out, and what is out of balance must shrink
                trial = u.copy()
                trial[free] += part * change
                if np.linalg.det(solver.deformation(trial)).min() > 0 and (
                    np.linalg.norm(solver.force(trial)[free]) < np.linalg.norm(force[free])
                ):
                    break
                part /= 2
                if part < 1e-3:
                    return None
            u = trial
        return None


def cube(n: int) -> Cube:
    """Of n³ nodes."""
    mesh = brick((n - 1,) * 3)
    tissue = pp.Tissue(mesh, YOUNG, POISSON, mesh.nodes[:, 2] == 0, element="P1")
    return Cube(n, tissue, FiniteElements(tissue).push(TOP, PUSH, 2 * tissue.edge).displacement)


def _cofactor(F: Float64) -> Float64:
    return np.linalg.det(F)[..., None, None] * np.linalg.inv(F).swapaxes(-1, -2)


def _stable_stress(F: Float64, lam: Float64, mu: Float64) -> Float64:
    s = (lam + mu) * (np.linalg.det(F) - 1) - mu
    return np.asarray(mu[..., None, None] * F + s[..., None, None] * _cofactor(F))


def _stable_tangent(F: Float64, lam: Float64, mu: Float64) -> Float64:
    C, one, J = _cofactor(F), np.eye(3), np.linalg.det(F)
    G = C / J[..., None, None]
    s = ((lam + mu) * (J - 1) - mu) * J
    A = mu[..., None, None, None, None] * np.einsum("ik,jl->ijkl", one, one)
    A = A + (lam + mu)[..., None, None, None, None] * np.einsum("...ij,...kl->...ijkl", C, C)
    turned = np.einsum("...ij,...kl->...ijkl", G, G) - np.einsum("...il,...kj->...ijkl", G, G)
    return np.asarray(A + s[..., None, None, None, None] * turned)


STABLE = Law(_stable_stress, _stable_tangent)
"""W = μ/2 (tr FᵀF − 3) + (λ + μ)/2 (J − 1 − μ/(λ + μ))²: Smith, de Goes & Kim, ACM Trans. Graph. 37 (2018) 12."""


def _green_stress(F: Float64, lam: Float64, mu: Float64) -> Float64:
    E = (F.swapaxes(-1, -2) @ F - np.eye(3)) / 2
    trace = np.einsum("...ii", E)
    return np.asarray(F @ (2 * mu[..., None, None] * E + (lam * trace)[..., None, None] * np.eye(3)))


def _green_tangent(F: Float64, lam: Float64, mu: Float64) -> Float64:
    one = np.eye(3)
    E = (F.swapaxes(-1, -2) @ F - one) / 2
    S = 2 * mu[..., None, None] * E + (lam * np.einsum("...ii", E))[..., None, None] * one
    A = np.einsum("ik,...jl->...ijkl", one, S)
    A = A + lam[..., None, None, None, None] * np.einsum("...ij,...kl->...ijkl", F, F)
    left = np.einsum("...ik,jl->...ijkl", F @ F.swapaxes(-1, -2), one)
    return np.asarray(A + mu[..., None, None, None, None] * (np.einsum("...il,...kj->...ijkl", F, F) + left))


GREEN = Law(_green_stress, _green_tangent)
"""Saint Venant and Kirchhoff's W = μ tr E² + λ/2 (tr E)², E = (FᵀF − 1)/2."""
