"""A scan with all that a file keeps, and whether two are the same."""

import numpy as np

import palpate as pp


def a_scan(moving=True, rows=40):
    panel = pp.Panel((rows, 40), (0.4, 0.5), (-8, -3, 0), (0, -1, 0), (1, 0, 0))
    views = pp.circular_views(panel, radius=200, height=1000, count=3, fulcrum=40 if moving else None)
    mask = np.ones((rows, 40), bool)
    mask[3] = False
    counts = np.random.default_rng(0).poisson(100, views.shape) + 0.25
    return pp.Scan(counts, [1000, 2000, 3000], views, 1.5, mask)


def same(a, b):
    fields = all(np.array_equal(getattr(a, n), getattr(b, n)) for n in ("counts", "incident", "background", "mask"))
    poses = all(
        np.array_equal(getattr(p, n), getattr(q, n))
        for p, q in zip(a.views.panels, b.views.panels, strict=True)
        for n in ("shape", "pitch", "origin", "row_axis", "column_axis")
    )
    return fields and poses and np.array_equal(a.views.source, b.views.source)
