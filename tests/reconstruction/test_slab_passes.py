"""Passes over volumes in slabs: sums over slabs are those of the whole, in files as in memory, and no voxel is lost."""

import sys
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.projector_scenes import about_either_axis, circular, head, noise, skew

import palpate as pp
from palpate import _core
from palpate.reconstruction import slab_passes
from palpate.reconstruction.optimizers.problem import Problem
from palpate.reconstruction.slab_passes import passes, slabs_of, telling_slabs

in_files = pytest.mark.skipif(sys.platform == "win32", reason="no limit of memory on Windows")
FEW = settings(max_examples=12, deadline=None)


def coarse(case):
    """The case with a sixth of the voxels and pixels along each side of a slice."""
    views, grid, _ = case()
    panels = [
        pp.Panel([n // 6 for n in p.shape], [6 * d for d in p.pitch], p.origin, p.row_axis, p.column_axis)
        for p in views.panels
    ]
    shape = (min(grid.shape[0], 20), *(n // 6 for n in grid.shape[1:]))
    spacing = (grid.spacing[0], *(6 * d for d in grid.spacing[1:]))
    return pp.Projector(pp.Views(views.source, panels), pp.Grid(shape, spacing, grid.origin))


def cuts(slices):
    ends = st.lists(st.integers(1, slices - 1), unique=True, max_size=5)
    return ends.map(lambda at: list(pairwise([0, *sorted(at), slices])))


@pytest.mark.parametrize("case", [circular, head, about_either_axis, skew], ids=lambda case: case.__name__)
@FEW
@given(data=st.data())
def test_slabs_project_to_what_the_whole_does_and_back(case, data):
    A = coarse(case)
    slabs = data.draw(cuts(A.domain_shape[0]))
    x, p = noise(A.grid), np.random.default_rng(3).random(A.range_shape, dtype=np.float32)
    projected, back = np.full(A.range_shape, np.nan, np.float32), np.full(A.domain_shape, np.nan, np.float32)
    for slab in slabs:
        A.project_slices(*slab, x, projected)
        A.backproject_slices(*slab, p, back)
    np.testing.assert_allclose(projected, A(x), rtol=1e-5, atol=1e-5 * projected.max())
    np.testing.assert_allclose(back, A.T(p), rtol=1e-5, atol=1e-6 * back.max())


@pytest.mark.parametrize("potential", ["quadratic", "lange", "huber"])
@FEW
@given(data=st.data())
def test_slabs_have_the_sums_over_pairs_of_the_whole(potential, data):
    A = coarse(circular)
    slabs = data.draw(cuts(A.domain_shape[0]))
    prior = pp.Prior(potential, strength=1.0, edge=0.3)
    problem = Problem(A, None, prior, 0.7, "precomputed", linear=noise(A.grid, 4))
    f, before, u = (noise(A.grid, seed) for seed in range(3))
    parts = sum(problem.penalty_before(slab, f) for slab in slabs)
    assert parts == pytest.approx(problem.penalty(f), rel=1e-12)
    spacing, law = A.grid.spacing, problem.law
    bends = [_core.subspace.prior_curvatures(f, before, u, spacing, *law, *problem.pairs_before(s)) for s in slabs]
    np.testing.assert_allclose(
        np.sum(bends, 0), _core.subspace.prior_curvatures(f, before, u, spacing, *law), rtol=1e-12
    )
    whole, part = noise(A.grid, 6), noise(A.grid, 6)
    data_curvature = np.ones(A.grid.shape, np.float32)
    slopes = _core.subspace.search_direction(f, before, whole, data_curvature, 1, 0.7, spacing, *law)
    sums = [_core.subspace.search_direction(f, before, part, data_curvature, 1, 0.7, spacing, *law, *s) for s in slabs]
    np.testing.assert_array_equal(part, whole)
    np.testing.assert_allclose(np.sum(sums, 0), slopes, rtol=1e-12)


@in_files
@FEW
@given(shape=st.tuples(st.integers(30, 50), st.integers(100, 140), st.integers(100, 140)), room=st.integers(2, 8))
def test_no_voxel_is_lost_on_its_way_through_files(shape, room, tmp_path_factory):
    """Each pass writes a slab and the slice after it, as descent does, and reads those before."""
    rng = np.random.default_rng(room)
    with pp.memory_limit("500MB", tmp_path_factory.mktemp("scratch")):
        _core.base.set_scratch(str(tmp_path_factory.getbasetemp()), 4 * shape[1] * shape[2] * room)
        given, made = np.empty(shape, np.float32), np.full(shape, np.nan, np.float32)
        given[:] = truth = rng.random(shape, dtype=np.float32).copy()
        assert _core.base.scratch_use()[1] > 0
        slabs = slabs_of(shape)
        assert len(slabs) > 1
        assert [first for first, _ in slabs[1:]] == [end for _, end in slabs[:-1]]
        for turn in range(3):
            copied = 0
            for first, end in passes(slabs, [given], [made]):
                beside = min(end + 1, shape[0])
                made[copied:beside] = given[copied:beside]
                copied = beside
                made[first:end] += 1
            truth = truth + np.float32(1)
            np.testing.assert_array_equal(made, truth, err_msg=f"turn {turn}")
            given, made = made, given


@in_files
def test_each_slab_of_a_pass_is_told(tmp_path):
    """By number and count, in a block that asks for it; one slab alone is not."""
    heard = []
    with pp.memory_limit("500MB", tmp_path):
        _core.base.set_scratch(str(tmp_path), 4 * 10 * 10 * 12)
        volume = np.zeros((30, 10, 10), np.float32)
        slabs = slabs_of(volume.shape)
        with telling_slabs(lambda *slab: heard.append(slab)):
            gone_over = [(*heard[-1], slab) for slab in passes(slabs, [volume])]
            list(passes(slabs[:1], [volume]))
        list(passes(slabs, [volume]))
    assert len(slabs) > 2
    assert gone_over == [(k + 1, len(slabs), slab) for k, slab in enumerate(slabs)]
    assert len(heard) == len(slabs)


@in_files
@pytest.mark.parametrize("optimizer", ["descent", "momentum", "auto"])
def test_iterates_in_files_are_those_in_memory(optimizer, tmp_path, monkeypatch):
    """Level with the panel, and turned: descent's slabs are then slices. With a support."""
    panel = pp.Panel((90, 100), (1, 1), (-50, -45, 0))
    level = pp.arc_views(panel, [-20, -5, 10, 20], radius=300, pivot=(0, 0, 20))
    about = pp.rotating_views(panel, [-15, 10], source=(0, 3, 300), pivot=(0, 0, 20))
    grid = pp.Grid((40, 84, 90), (1, 1, 1), (-45, -42, 1))
    body = pp.Phantom([(pp.Ellipsoid((2, 3, 21), (25, 30, 16)), 0.03)])
    support = pp.Labels((np.hypot(*np.ogrid[-42:42, -45:45]) < 38).astype(int) * np.ones(grid.shape, int), grid)
    monkeypatch.setattr(slab_passes, "LARGE", 1)
    for views in (level, about):
        scan = pp.simulate_scan(body, views, 2000, seed=2)
        options = dict(
            optimizer=optimizer,
            levels=1,
            iterations=40,
            tolerance=0,
            support=support,
            prior=pp.Prior(strength=0.3, edge=0.002),
        )
        whole = [step.objective for step in pp.iterates(scan, grid, **options)]
        volume = pp.reconstruct(scan, grid, **options).values
        with pp.memory_limit("500MB", tmp_path):
            _core.base.set_scratch(str(tmp_path), 4 * 84 * 90 * 39)
            assert len(slabs_of(grid.shape)) > 5
            steps = list(pp.iterates(scan, grid, **options))
            assert _core.base.scratch_use()[3] >= 2 * 4 * grid.size
        np.testing.assert_allclose([step.objective for step in steps], whole, rtol=1e-6)
        apart = np.linalg.norm(steps[-1].volume.values - volume) / np.linalg.norm(volume)
        assert apart < 1e-6
