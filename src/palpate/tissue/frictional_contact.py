"""Contacts that may slide or open: Signorini's and Coulomb's laws on the compliance of the patches."""

import numpy as np

from palpate.arrays import Float64
from palpate.errors import DataError

_ANGLES = 180
_MOST_SWEEPS = 5000


def sliding_forces(C: Float64, displacement: Float64, normals: Float64, friction: float) -> Float64:
    """(m, 3) N of the tools on the tissue, whose patches then move by v = C f.

    C: (3m, 3m) mm/N, symmetric positive definite. displacement: (m, 3) mm of the tools, from where they just touched.
    normals: (m, 3) unit, out of the tissue. friction: Coulomb's μ ≥ 0. For each contact, with p = −f·n and the slip
    s = v − d: p ≥ 0, s·n ≤ 0 and one of them 0; |f_t| ≤ μ p, and where the patch slips f_t = −μ p s_t/|s_t|. The slip is
    the whole way since touch, so a push is one step from rest.

    Gauss-Seidel over the contacts, each solved exactly with the others' forces given (M. Jean, Comput. Methods Appl.
    Mech. Eng. 177 (1999) 235). Raises `DataError` if that finds no balance: with much friction there may be none.
    """
    m = len(displacement)
    blocks = C.reshape(m, 3, m, 3).transpose(0, 2, 1, 3)
    force = np.zeros((m, 3))
    for _ in range(_MOST_SWEEPS):
        before = force.copy()
        for c in range(m):
            moved = np.einsum("dij,dj->i", blocks[c], force) - blocks[c, c] @ force[c]
            force[c] = _single_contact_force(blocks[c, c], displacement[c] - moved, normals[c], friction)
        if np.abs(force - before).max() <= 1e-13 * np.abs(force).max():
            return force
    raise DataError(
        f"friction: {friction:g} on {m} contacts: no balance found; give less friction, or move the contacts apart"
    )


def contact_states(force: Float64, normals: Float64, friction: float) -> tuple[str, ...]:
    """What each of m contacts does under (m, 3) N on the tissue: "open", "stick", or on the cone's edge "slide"."""
    pressure = -(force * normals).sum(axis=1)
    along = np.linalg.norm(force + pressure[:, None] * normals, axis=1)
    edge = along >= (1 - 1e-9) * friction * pressure
    return tuple("open" if p <= 0 else "slide" if e else "stick" for p, e in zip(pressure, edge, strict=True))


def _single_contact_force(C: Float64, way: Float64, normal: Float64, friction: float) -> Float64:
    """(3,) force of one contact whose tool would move its patch by `way` (3,) mm if they stuck."""
    if normal @ way >= 0:
        return np.zeros(3)
    stick = np.linalg.solve(C, way)
    pressure = -normal @ stick
    if np.linalg.norm(stick + pressure * normal) <= friction * pressure:
        return np.asarray(stick)
    if friction == 0:
        return np.asarray(normal * (normal @ way) / (normal @ C @ normal))
    return _sliding_force(C, way, normal, friction)


def _sliding_force(C: Float64, way: Float64, normal: Float64, friction: float) -> Float64:
    """The force on the cone's edge whose slip opposes its tangential part: a root in the angle round the normal."""
    first = np.linalg.svd(normal[None])[2][1]
    second = np.cross(normal, first)

    def at(angle: Float64) -> tuple[Float64, Float64, Float64]:
        """For (k,) angles: forces (k, 3), the slip's part across them and along them."""
        t = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
        edge = friction * t - normal
        inward = edge @ C @ normal  # must be negative: pressing moves the patch inwards
        force = edge * np.where(inward < 0, (normal @ way) / np.where(inward < 0, inward, 1), np.nan)[:, None]
        slip = force @ C - way
        return force, np.asarray(np.cross(t, slip) @ normal), np.asarray((slip * t).sum(axis=1))

    angle = np.linspace(0, 2 * np.pi, _ANGLES + 1)
    across = at(angle)[1]
    found = []
    for k in np.flatnonzero(across[:-1] * across[1:] <= 0):
        low, high = angle[k], angle[k + 1]
        for _ in range(8):  # each narrows the interval 63 times
            inner = np.linspace(low, high, 64)
            side = at(inner)[1]
            turns = np.flatnonzero(side[:-1] * side[1:] <= 0)
            low, high = inner[turns[:1]].item(), inner[turns[:1] + 1].item()
        force, _, along = at(np.array([low]))
        if along[0] <= 0:
            found.append(force[0])
    if not found:
        raise DataError(f"friction: {friction:g}: a pressed contact finds no balance; give less friction")
    return np.asarray(min(found, key=lambda f: float(f @ C @ f / 2 - f @ way)))
