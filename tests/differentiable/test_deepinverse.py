"""The physics for DeepInverse, outside the gate (make test-torch)."""

import numpy as np
import pytest
from support.scan_and_organ import GRID, VIEWS, projector

torch = pytest.importorskip("torch", reason="PyTorch is not installed here: make test-torch")
pytest.importorskip("deepinv", reason="DeepInverse is not installed here: make test-torch")
physics_of = pytest.importorskip("palpate.differentiable.deepinverse").ScanPhysics


def test_projections_of_a_batch_and_their_transpose():
    physics, rng = physics_of(projector()), np.random.default_rng(6)
    x, y = rng.random((2, 1, *GRID.shape), np.float32), rng.random((2, 1, *VIEWS.shape), np.float32)
    p = physics.A(torch.from_dlpack(x))
    np.testing.assert_array_equal(np.from_dlpack(p)[1, 0], projector()(x[1, 0]))
    np.testing.assert_array_equal(np.from_dlpack(physics.A_adjoint(torch.from_dlpack(y)))[1, 0], projector().T(y[1, 0]))
    assert float(physics.adjointness_test(torch.from_dlpack(x)).abs()) < 1e-6 * float((p**2).sum())
