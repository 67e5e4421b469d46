"""The check that every array passes on its way in."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.arrays import float32
from palpate.errors import DataError


@given(
    st.lists(st.floats(width=32), min_size=1, max_size=40),
    st.sampled_from([np.float32, np.float64]),
)
def test_finite_values_pass_and_others_are_refused(values, dtype):
    array = np.array(values, dtype)
    if all(np.isfinite(values)):
        np.testing.assert_array_equal(float32("values", array), array.astype(np.float32))
    else:
        with pytest.raises(DataError, match="not finite"):
            float32("values", array)


@pytest.mark.parametrize("bad", [np.nan, -np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", [0, 65535, 65536, 299_999])
def test_one_bad_value_in_many_is_found_and_named(bad, where):
    array = np.full((3, 100_000), np.finfo(np.float32).max, np.float32)
    array.flat[where] = bad
    place = ", ".join(str(i) for i in np.unravel_index(where, array.shape))
    with pytest.raises(DataError, match=rf"1 values are not finite \(first at index \({place}\)"):
        float32("values", array)


@pytest.mark.parametrize(
    "strange", [np.ones(3, complex), np.array(["1", "2"]), np.array(["2026-01-01"], "datetime64[D]")]
)
def test_what_holds_no_real_numbers_is_refused(strange):
    with pytest.raises(DataError, match=r"values: expected real numbers, got dtype .*; convert with \.astype\(float\)"):
        float32("values", strange)
