"""A sample of `make fuzz-core`, and states that outlive their models."""

import gc

import numpy as np
import pytest
from fuzz import core_calls
from support.example_organs import organ

import palpate as pp
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
