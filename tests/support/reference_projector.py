"""Exact line integrals through voxels, averaged over pixels: shares nothing with the kernels it judges.

Each ray is cut at every voxel face it crosses (Siddon, Med. Phys. 12, 1985) in float64; pixels are averaged by
Gauss-Legendre points in sub-squares, whose number is raised until the answer stands still.
"""

import numpy as np

CHUNK = 20_000


def line_integrals(values, grid, start, end):
    """Integrals (N,) of the voxels (z, y, x) along segments from start (N, 3) to end (N, 3), mm, all of one length.

    Several volumes at once, (z, y, x, volumes), give (N, volumes).
    """
    low, high = grid.bounds
    n = np.array(grid.shape[::-1])
    out = np.zeros((len(end), *values.shape[3:]))
    start = np.broadcast_to(start, end.shape)
    for first in range(0, len(end), CHUNK):
        part = slice(first, first + CHUNK)
        out[part] = _some(values, low, high, n, start[part], end[part])
    return out


def _some(values, low, high, n, start, end):
    ray = end - start
    ray = np.where(np.abs(ray) < 1e-12, 1e-12, ray)
    to_faces = (np.stack([low, high])[:, None] - start) / ray
    enter = np.clip(to_faces.min(axis=0).max(axis=1), 0, 1)
    leave = np.clip(to_faces.max(axis=0).min(axis=1), 0, 1)
    hits = np.flatnonzero(leave > enter)
    total = np.zeros((len(end), *values.shape[3:]))
    if len(hits) == 0:
        return total
    start, ray, enter, leave = start[hits], ray[hits], enter[hits], leave[hits]
    cuts = [enter[:, None], leave[:, None]]
    for axis in range(3):
        faces = np.linspace(low[axis], high[axis], n[axis] + 1)
        ends = np.sort(np.stack([start[:, axis] + t * ray[:, axis] for t in (enter, leave)]), axis=0)
        first = np.searchsorted(faces, ends[0], side="right")
        most = int((np.searchsorted(faces, ends[1], side="left") - first).max(initial=0))
        index = np.minimum(first[:, None] + np.arange(most), n[axis])
        cuts.append(np.clip((faces[index] - start[:, axis, None]) / ray[:, axis, None], enter[:, None], leave[:, None]))
    t = np.sort(np.concatenate(cuts, axis=1), axis=1)
    middle = start[:, None] + 0.5 * (t[:, 1:] + t[:, :-1])[:, :, None] * ray[:, None]
    voxel = np.clip(((middle - low) / ((high - low) / n)).astype(int), 0, n - 1)
    lengths = np.diff(t, axis=1) * np.linalg.norm(ray, axis=1)[:, None]
    total[hits] = np.einsum("rc,rc...->r...", lengths, values[voxel[..., 2], voxel[..., 1], voxel[..., 0]])
    return total


def pixel_means(values, views, grid, view, pixels, squares):
    """Mean line integral (N,) over the area of each of `stored_pixels` (N, 2) in (row, column) order, 4 rays a sub-square.

    Several volumes at once, (z, y, x, volumes), give (N, volumes).
    """
    gauss = np.array([-1, 1]) / np.sqrt(12)
    steps = (np.arange(squares)[:, None] - (squares - 1) / 2 + gauss).ravel() / squares
    offsets = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    points = (np.asarray(pixels)[:, None] + offsets).reshape(-1, 2)
    panel, source = views.panels[view], views.source[view]
    ends = (
        panel.origin
        + points[:, :1] * panel.pitch[0] * panel.row_axis
        + points[:, 1:] * panel.pitch[1] * panel.column_axis
    )
    rays = line_integrals(values, grid, source, ends)
    return rays.reshape(len(pixels), -1, *values.shape[3:]).mean(axis=1)


def projections(values, views, grid, view, pixels, within=1e-3):
    """`pixel_means`, refined until another refinement changes each volume's by less than `bounded_vector` (relative L2)."""
    values = np.asarray(values, dtype=np.float64)
    squares = 2
    coarse = pixel_means(values, views, grid, view, pixels, squares)
    while squares < 33:
        squares = 2 * squares + 1
        fine = pixel_means(values, views, grid, view, pixels, squares)
        if (np.linalg.norm(fine - coarse, axis=0) <= within * np.linalg.norm(fine, axis=0)).all():
            return fine
        coarse = fine
    raise AssertionError("the oracle did not settle")
