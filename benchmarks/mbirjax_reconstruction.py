"""mbirjax's MAP reconstruction (vectorised coordinate descent, q-generalised Gaussian prior) of a scan of ours.

Its nearest geometry is TranslationModel: an object that moves over a panel which stays below the source. A fixed panel is
such a one, if it is large enough to follow every source and pixels outside the real panel weigh nothing; sources must
then sit on multiples of the pixel pitch (`workloads.circular(snap=)`). Its voxels, pixels and counts are ours.
"""

import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

import palpate as pp


class Translation:
    """A scan of ours with one fixed panel parallel to the slices, as mbirjax sees it."""

    def __init__(self, scan: pp.Scan, grid: pp.Grid) -> None:
        import mbirjax  # seconds to load: only when asked for

        panel, source = scan.views.panels[0], scan.views.source
        (dv, du), (dz, dy, dx) = panel.pitch, grid.spacing
        height, middle = source[0, 2] - panel.origin[2], grid.bounds.mean(axis=0)
        step = source[:, :2] - middle[:2]
        low, high = grid.bounds - middle
        reach = [max(abs(low[i]), high[i]) + np.abs(step[:, i]).max() for i in (1, 0)]
        magnified = height / (source[0, 2] - grid.bounds[1, 2])
        rows, columns = (int(2 * np.ceil(r * magnified / d)) + 8 for r, d in zip(reach, (dv, du), strict=True))
        self.first = np.stack(
            [  # where the real panel's pixel (0, 0) lies on each large one
                (panel.origin[1] - source[:, 1]) / dv + (rows - 1) / 2,
                (panel.origin[0] - source[:, 0]) / du + (columns - 1) / 2,
            ],
            axis=1,
        )
        if np.abs(self.first - np.round(self.first)).max() > 1e-6:
            raise ValueError("sources are not on multiples of the pixel pitch")
        self.first = np.round(self.first).astype(int)
        self.shape, self.grid = (len(source), rows, columns), grid
        moved = np.stack([step[:, 0], 0 * step[:, 0], step[:, 1]], axis=1)
        self.model = mbirjax.TranslationModel(self.shape, moved, float(height), float(source[0, 2] - middle[2]))
        self.model.set_params(
            delta_det_row=dv, delta_det_channel=du, recon_shape=grid.shape[0:1] + grid.shape[2:] + grid.shape[1:2],
            delta_voxel=dx, voxel_row_aspect=dz / dx, voxel_slice_aspect=dy / dx, verbose=0,
        )  # fmt: skip

    def placed(self, pixels: np.ndarray) -> np.ndarray:
        """(views, rows, columns) of the real panel on the large one, 0 elsewhere."""
        out = np.zeros(self.shape, np.float32)
        for view, (row, column) in enumerate(self.first):
            here, there = zip(
                *(_overlap(f, n, m) for f, n, m in zip((row, column), pixels.shape[1:], self.shape[1:], strict=True)),
                strict=True,
            )
            out[(view, *there)] = pixels[(view, *here)]
        return out

    def project(self, values: np.ndarray) -> np.ndarray:
        """Projections on the large panel of a volume (z, y, x)."""
        return np.asarray(self.model.forward_project(np.ascontiguousarray(values.transpose(0, 2, 1))))

    def same_prior(self, prior: pp.Prior, beta: float) -> None:
        """Sets its prior to β R of ours and no weight beside those of the pixels, f >= 0.

        Its prior sums ρ(Δ) = Δ²/2σ² / (1 + |Δ/Tσ|^(p−q)) over the pairs of 6 neighbours, each a sixth: with p = 2 that is
        "generalized", if all pairs weigh alike (cubic voxels, ω = d): β ω = 1/6σ², edge = Tσ.
        """
        d = self.grid.spacing
        if prior.potential != "generalized" or prior.neighbours != 6 or min(d) != max(d) or prior.edge is None:
            raise ValueError("its prior is the generalised one over 6 neighbours at cubic voxels")
        sigma = float(1 / np.sqrt(6 * beta * d[0]))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that its own choice is given up is what is wanted
            self.model.set_params(
                auto_regularize_flag=False, sigma_y=1.0, sigma_x=sigma, T=prior.edge / sigma, p=2.0, q=prior.exponent,
                qggmrf_nbr_wts=[1.0, 1.0, 1.0], positivity_flag=True,
            )  # fmt: skip

    def iterates(
        self,
        p: np.ndarray,
        weights: np.ndarray,
        start: np.ndarray,
        count: int,
        see: Callable[[float, float, np.ndarray], bool],
    ) -> None:
        """Runs at most `count` iterations from a volume (z, y, x); see(wall seconds so far, CPU seconds, volume) after each.

        p, weights: line integrals and their weights on the real panel. What `see` takes is not counted; it answers whether
        to go on.
        """
        one = self.model.vcd_partition_iterator
        apart, apart_cpu = 0.0, 0.0

        class EnoughError(Exception):
            pass

        def watched(*given: Any) -> Any:
            nonlocal apart, apart_cpu
            made = one(*given)
            made[0].block_until_ready()
            now, cpu = time.perf_counter(), time.process_time()
            flat = np.asarray(made[0]).reshape(self.grid.shape[0], self.grid.shape[2], -1)
            if not see(
                now - began - apart, cpu - began_cpu - apart_cpu, flat.transpose(0, 2, 1)[:, : self.grid.shape[1]]
            ):
                raise EnoughError
            apart, apart_cpu = apart + time.perf_counter() - now, apart_cpu + time.process_time() - cpu
            return made

        self.model.vcd_partition_iterator = watched
        try:
            sinogram, weights = self.placed(p), self.placed(weights)
            np.random.seed(0)  # noqa: NPY002 (its subsets are drawn from there)
            began, began_cpu = time.perf_counter(), time.process_time()
            self.model.recon(
                sinogram,
                weights,
                init_recon=np.ascontiguousarray(start.transpose(0, 2, 1)),
                max_iterations=count,
                stop_threshold_change_pct=0,
                logfile_path=None,
                print_logs=False,
            )
        except EnoughError:
            pass
        finally:
            self.model.vcd_partition_iterator = one


def _overlap(first: int, n: int, m: int) -> tuple[slice, slice]:
    """Of n pixels put at `first` of m: which they are, and where they come to lie."""
    a, b = max(0, -first), min(n, m - first)
    return slice(a, b), slice(first + a, first + b)
