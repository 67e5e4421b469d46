"""Arrays of other libraries come in by DLPack, without a copy where the layout allows, and results leave by it."""

import numpy as np
import pytest
from support.brick_meshes import block
from support.jax_here import required_jax

import palpate as pp
from palpate.arrays import float32, float64
from palpate.errors import DataError

PANEL = pp.Panel(shape=(12, 16), pitch=(4, 4), origin=(-30, -22, 0))
VIEWS = pp.arc_views(PANEL, angles=[-15, 0, 15], radius=400, pivot=(0, 0, 15))
GRID = pp.Grid(shape=(4, 10, 12), spacing=(5, 3, 3), origin=(-16.5, -13.5, 7))


class Exported:
    """What DLPack asks for, and nothing else that NumPy could read."""

    def __init__(self, array, device=(1, 0)):
        self._array, self._device = array, device

    def __dlpack__(self, **options):
        return self._array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self._device


class Unwilling(Exported):
    def __dlpack__(self, **options):
        raise BufferError("it requires a gradient")


def from_jax(array):
    return required_jax().device_put(array)


def address(array):
    return array.__array_interface__["data"][0]


def test_memory_is_shared_where_dtype_and_layout_allow():
    x = np.random.default_rng(1).random((3, 4, 5), np.float32)
    assert address(float32("x", Exported(x))) == address(x)
    assert address(float32("x", x)) == address(x)
    volume = np.ones(GRID.shape, np.float32)
    assert address(pp.Volume(Exported(volume), GRID).values) == address(volume)
    doubles = x.astype(np.float64)
    assert address(float64("x", Exported(doubles))) == address(doubles)


def test_memory_of_jax_is_shared():
    x = from_jax(np.random.default_rng(1).random((3, 4, 5), np.float32))
    assert address(float32("x", x)) == x.unsafe_buffer_pointer()


def test_other_types_and_layouts_are_converted():
    x = np.arange(60, dtype=np.float64).reshape(5, 4, 3).T
    found = float32("x", Exported(x))
    assert found.flags.c_contiguous
    np.testing.assert_array_equal(found, x)


@pytest.mark.parametrize("wrap", [Exported, from_jax], ids=["bare", "jax"])
def test_public_functions_take_it(wrap):
    rng = np.random.default_rng(2)
    x = rng.random(GRID.shape, np.float32)
    A = pp.Projector(VIEWS, GRID)
    p = A(x)
    np.testing.assert_array_equal(A(wrap(x)), p)
    np.testing.assert_array_equal(A @ wrap(x), p)
    np.testing.assert_array_equal(A.T(wrap(p)), A.T(p))
    np.testing.assert_array_equal(A.matvec(wrap(x.ravel())), p.ravel())
    counts = rng.poisson(500 * np.exp(-0.01 * p)).astype(np.float32)
    mask = rng.random(p.shape) > 0.1
    scan = pp.Scan(wrap(counts), wrap(np.full(3, 500, np.float32)), VIEWS, mask=wrap(mask))
    np.testing.assert_array_equal(scan.counts, counts)
    np.testing.assert_array_equal(scan.mask, mask)
    likelihood = pp.Transmission.of(scan)
    assert likelihood.value(wrap(p)) == likelihood.value(p) > 0
    np.testing.assert_array_equal(likelihood.slope(wrap(p)), likelihood.slope(p))
    squares = pp.WeightedLeastSquares.of(scan)
    assert squares.value(wrap(p)) == squares.value(p) > 0
    np.testing.assert_array_equal(squares.slope(wrap(p)), squares.slope(p))
    labels = (x > 0.5).astype(np.int32)
    np.testing.assert_array_equal(pp.Labels(wrap(labels), GRID).values, labels)
    assert pp.nmse(wrap(x), wrap(x)) == 0


@pytest.mark.parametrize("wrap", [Exported, from_jax], ids=["bare", "jax"])
def test_meshes_and_pushes_take_it(wrap):
    tissue = block(5)
    mesh = tissue.mesh
    same = pp.TetMesh(wrap(mesh.nodes.astype(np.float32)), wrap(mesh.tets), wrap(mesh.region))
    other = pp.Tissue(same, wrap(np.float32([5])), 0.4, wrap(tissue.fixed))
    np.testing.assert_array_equal(other.fixed, tissue.fixed)
    top = mesh.nodes[mesh.nodes[:, 2].argmax()].astype(np.float32)
    push = np.float32([0, 0, -1])
    expected = pp.finite_elements(other).push(top, push, 10).force
    np.testing.assert_array_equal(pp.finite_elements(other).push(wrap(top), wrap(push), 10).force, expected)
    assert expected[2] > 0


@pytest.mark.parametrize(("kind", "name"), [(2, "CUDA:1"), (8, "Metal:1"), (99, "DLPack kind 99:1")])
def test_another_device_is_refused_by_name(kind, name):
    x = Exported(np.ones(GRID.shape, np.float32), (kind, 1))
    with pytest.raises(DataError, match=rf"volume: the array is on the device {name}.*CPU; copy it there"):
        pp.Projector(VIEWS, GRID)(x)


def test_what_cannot_be_exported_is_refused():
    with pytest.raises(DataError, match=r"volume: Unwilling does not export its memory \(it requires a gradient\)"):
        pp.Projector(VIEWS, GRID)(Unwilling(np.ones(GRID.shape, np.float32)))


def test_values_are_checked_as_any_others():
    x = np.ones(GRID.shape, np.float32)
    x[1, 2, 3] = np.nan
    with pytest.raises(DataError, match=r"1 values are not finite \(first at index \(1, 2, 3\)"):
        pp.Projector(VIEWS, GRID)(Exported(x))


def test_results_leave_without_a_copy():
    p = pp.Projector(VIEWS, GRID)(np.ones(GRID.shape, np.float32))
    np.testing.assert_array_equal(np.asarray(required_jax().dlpack.from_dlpack(p)), p)
    assert address(np.from_dlpack(p)) == address(p)
