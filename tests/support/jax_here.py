"""JAX for tests; a skip that says how to get it, and a failure where it is required, as in the gate."""

import os

import pytest

MISSING = "JAX is not installed here: pip install 'palpate[jax]'"


def required_jax():
    """The module jax."""
    if os.environ.get("PALPATE_REQUIRE_JAX") != "1":
        return pytest.importorskip("jax", reason=MISSING)
    try:
        import jax
    except ImportError:
        pytest.fail(MISSING)
    return jax
