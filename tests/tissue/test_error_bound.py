"""The bound on a relative error, against errors that are known."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from palpate.tissue.error_bound import relative


@given(st.integers(0, 2**31), st.floats(1e-6, 0.9), st.floats(-1, 1))
@example(0, 0.5, 1.0)
def test_the_relative_error_is_never_above_its_bound(seed, size, along):
    """Answers u = u* + e in any norm, e partly along u*: beyond u* the true share of u* is larger than that of u."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(5, 5)) + 3 * np.eye(5)
    exact = rng.normal(size=5)
    exact /= np.linalg.norm(root @ exact)
    aside = rng.normal(size=5)
    aside /= np.linalg.norm(root @ aside)
    error = size * (along * exact + (1 - abs(along)) * aside)
    distance, energy_norm = np.linalg.norm(root @ error), np.linalg.norm(root @ (exact + error))
    assert distance <= relative(distance, energy_norm) * (1 + 1e-12)
    assert relative(2.0, 1.0) == np.inf
