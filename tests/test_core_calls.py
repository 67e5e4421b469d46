"""A sample of `make fuzz-core`, and states that outlive their models."""

import gc

import numpy as np
import pytest
from fuzz import core_calls
from support.example_organs import organ

import palpate as pp
from palpate import _core
from palpate.tissue.models.registry import names


def test_a_sample_of_random_calls():
    told, failures = core_calls.run(1000, seed=11)
    assert not failures, failures[0]
    assert told.total() == 1000


@pytest.mark.parametrize(("name", "options"), [*((name, {}) for name in names()), ("multigrid", {"interval": 4})])
def test_a_state_keeps_its_model(name, options):
    tissue = organ(5)
    model = pp.model(tissue, name, **options)
    state, nodes = model.native.make_state(), len(tissue.mesh.nodes)
    del model
    gc.collect()
    if name == "compliance":
        state.make_columns(np.arange(3, dtype=np.int32))
    assert state.u.shape == (nodes, 3)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"source": [[0.0, 0, 10.2]]}, "source: it must lie above the grid"),
        ({"source": [[0.0, 0, -5.0]]}, "source: it must lie above the grid"),
        ({"origin": [[0.0, 0, 200.0]]}, "the panel lies above the source"),
        ({"source": [[0.0, 0, 10.6]], "pitch": [[1e-6, 1e-6]]}, "more than 100000 pixels"),
    ],
)
def test_the_kernels_refuse_a_geometry_that_their_slices_cannot_have(change, told):
    """Python never asks for one; another caller of the core may."""
    given = {
        "source": [[0.0, 0, 100.0]],
        "origin": [[-5.0, -5, -10]],
        "row_axis": [[0.0, 1, 0]],
        "column_axis": [[1.0, 0, 0]],
        "pitch": [[1.0, 1.0]],
        "shape": [10.0, 10, 10],
        "spacing": [1.0, 1, 1],
        "grid_origin": [-4.5, -4.5, 0.5],
    }
    sizes = {"rows": 11, "columns": 11, "tolerance": 0.01}
    _core.projection.ScanGeometry(**{name: np.array(value) for name, value in given.items()}, **sizes)
    with pytest.raises(ValueError, match=told):
        _core.projection.ScanGeometry(**{name: np.array(value) for name, value in (given | change).items()}, **sizes)
