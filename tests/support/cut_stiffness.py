"""The stiffness of a cut mesh, assembled cell by cell and entry by entry, to check the product's by."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu


def stiffness(mesh, young, poisson, element="smoothed"):
    """(3N, 3N) N/mm, sparse. young: (M,) kPa. poisson: (M,)."""
    E, nu = young / 1000, poisson
    mu, lam = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    part = mesh.share * np.linalg.det(mesh.nodes[mesh.tets][:, 1:] - mesh.nodes[mesh.tets][:, :1]) / 6
    gradients = [_gradients(mesh.nodes[tet]) for tet in mesh.tets]
    rows_of, columns_of, values = [], [], []
    for tets, volumes, shear, bulk in cells(mesh, part, mu, lam, element):
        H = {}
        for tet, volume in zip(tets, volumes, strict=True):
            for node, gradient in zip(mesh.tets[tet].tolist(), gradients[tet], strict=True):
                H[node] = H.get(node, 0) + volume * gradient / sum(volumes)
        nodes = list(H)
        G = np.array([H[node] for node in nodes])
        rows = (3 * np.array(nodes)[:, None] + np.arange(3)).ravel()
        strain = np.zeros((6, len(rows)))
        strain[0, 0::3], strain[1, 1::3], strain[2, 2::3] = G.T
        strain[3, 0::3], strain[3, 1::3] = G[:, 1], G[:, 0]
        strain[4, 1::3], strain[4, 2::3] = G[:, 2], G[:, 1]
        strain[5, 0::3], strain[5, 2::3] = G[:, 2], G[:, 0]
        C = np.diag([2 * shear] * 3 + [shear] * 3)
        C[:3, :3] += bulk
        rows_of.append(np.repeat(rows, len(rows)))
        columns_of.append(np.tile(rows, len(rows)))
        values.append((sum(volumes) * strain.T @ C @ strain).ravel())
    entries = np.concatenate(values), (np.concatenate(rows_of), np.concatenate(columns_of))
    return coo_array(entries, shape=(3 * len(mesh.nodes),) * 2).tocsc()


def solution(tissue, W, displacement):
    """(3m,) N of the tools and (3N,) mm, from patches' loads W (3N, 3m), by a factorisation from scratch."""
    K = stiffness(tissue.mesh, tissue.young, tissue.poisson, tissue.element)
    free = np.flatnonzero(np.repeat(~tissue.held, 3))
    columns = np.zeros_like(W)
    columns[free] = splu(K[free][:, free]).solve(W[free])
    force = np.linalg.solve(W.T @ columns, displacement)
    return force, columns @ force


def cells(mesh, part, mu, lam, element):
    """Tetrahedra, their volumes in it, μ and λ of each cell over which strain is averaged."""
    if element == "P1":
        for tet, volume in enumerate(part):
            yield [tet], [volume], mu[tet], lam[tet]
        return
    edges, nodes = {}, {}
    for tet, corners in enumerate(mesh.tets.tolist()):
        region = int(mesh.region[tet])
        for i, a in enumerate(corners):
            nodes.setdefault((region, a), []).append(tet)
            for b in corners[:i]:
                edges.setdefault((region, min(a, b), max(a, b)), []).append(tet)
    for tets in edges.values():
        volumes = part[tets] / 6
        yield tets, list(volumes), float((volumes * mu[tets]).sum() / volumes.sum()), 0.0
    for tets in nodes.values():
        volumes = part[tets] / 4
        soft = float((volumes / lam[tets]).sum()) if (lam[tets] > 0).all() else np.inf
        yield tets, list(volumes), 0.0, float(volumes.sum()) / soft


def _gradients(x):
    """(4, 3) 1/mm of the shape functions of a tetrahedron (4, 3) mm."""
    return np.linalg.inv(np.column_stack([np.ones(4), x]))[1:].T
