"""The projector to its callers: arrays for the result, refusals, SciPy's linear operators, and help."""

import pydoc

import numpy as np
import pytest
from scipy.sparse.linalg import aslinearoperator, lsqr
from support.projector_scenes import centred, noise, several_threads, small  # noqa: F401

import palpate as pp


def test_out_is_filled_and_its_old_values_do_not_matter():
    views, grid = small()
    A = pp.Projector(views, grid)
    p, f = np.full(A.range_shape, np.nan, np.float32), np.full(grid.shape, np.nan, np.float32)
    assert A(noise(grid), out=p) is p
    assert A.T(p, out=f) is f
    np.testing.assert_array_equal(p, A(noise(grid)))
    np.testing.assert_array_equal(f, A.T(p))


def test_wrong_arrays_are_refused_before_anything_is_written():
    views, grid = small()
    A = pp.Projector(views, grid)
    out = np.full(A.range_shape, 7, np.float32)
    with pytest.raises(ValueError, match=r"volume: expected shape \(3, 5, 7\), got \(3, 5, 8\)"):
        A(np.zeros((3, 5, 8)), out=out)
    bad = noise(grid)
    bad[1, 2, 3] = np.nan
    with pytest.raises(ValueError, match=r"volume: 1 values are not finite.*\(1, 2, 3\).*nan_to_num"):
        A(bad, out=out)
    assert (out == 7).all()
    with pytest.raises(ValueError, match=r"projections: expected shape \(2, 12, 14\)"):
        A.T(np.zeros((2, 12, 13)))
    with pytest.raises(ValueError, match=r"out: expected a C-contiguous float32 array of shape \(2, 12, 14\)"):
        A(noise(grid), out=np.zeros(A.range_shape))  # type: ignore[arg-type]


def refused(views, grid, *words, tolerance=1e-3):
    with pytest.raises(ValueError) as caught:
        pp.Projector(views, grid, tolerance)
    for word in words:
        assert word in str(caught.value)


def test_geometries_that_cannot_be_are_refused():
    views, grid = small()
    away, _ = small(origin=(900, 900, 0))
    refused(away, grid, "geometry misses the volume", "rows", "columns", "check the grid's origin")
    above = pp.Grid(grid.shape, grid.spacing, (-3, -2, 78))
    refused(views, above, "behind the focal spot of view 0", "between source and panel")
    touching = pp.Grid((3, 30, 30), grid.spacing, (-10, -10, 74))
    refused(
        views, touching, "source of view 0 at (9, 7, 80) mm lies inside the grid or within a voxel", "move the grid"
    )
    below = pp.Grid(grid.shape, grid.spacing, (-3, -2, -40))
    refused(views, below, "geometry misses the volume", "behind the panel of view 0", "move the grid's origin")
    overhead, _ = small(origin=(-8, -8, 200))
    refused(overhead, grid, "behind the focal spot of view 0", "check the panel's origin and axes")
    sideways = pp.Views([*views.source, (3000, 0, 60)], views.panels[0])
    with pytest.warns(UserWarning, match=r"misses the panel in views \[2\]"):
        assert not pp.Projector(sideways, grid)(np.ones(grid.shape))[2].any()
    refused(views, grid, "tolerance", "0.0", "between", tolerance=0.0)


def test_it_is_a_linear_operator_of_scipy():
    """Least squares by SciPy's LSQR recovers a volume from its projections, through A and through Aᵀ's own operator."""
    views = pp.arc_views(
        centred((20, 24), (1, 1), (0, 0, 0), (0, 1, 0), (1, 0, 0)), np.linspace(-60, 60, 24), radius=200
    )
    A = pp.Projector(views, pp.Grid((4, 6, 5), (2, 2, 2), (-4, -5, 2)))
    x = np.random.default_rng(1).uniform(0.5, 1, A.domain_shape).astype(np.float32)
    y = A(x)
    assert y.any()
    for operator, values, image in ((A, x, y), (A.T, y, A.T(y))):
        assert ((operator @ values) == image).all()
        wrapped = aslinearoperator(operator)
        assert wrapped.shape == (image.size, values.size)
        assert wrapped.dtype == np.float32
        np.testing.assert_array_equal(wrapped.matvec(values.ravel()), image.ravel())
        np.testing.assert_array_equal(wrapped.rmatvec(image.ravel()), operator.T(image).ravel())
    found = lsqr(aslinearoperator(A), y.ravel(), atol=1e-7, btol=1e-7, iter_lim=2000)[0]
    assert np.linalg.norm(found - x.ravel()) < 0.02 * np.linalg.norm(x)


def test_help_of_a_function_of_views_fits_on_a_screen():
    lines = pydoc.render_doc(pp.arc_views, renderer=pydoc.plaintext).splitlines()
    assert len(lines) < 40
    assert max(map(len, lines)) < 200  # the signature, which the screen wraps
    assert "ArrayLike" in lines[2]
