"""Errors and contrast of volumes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.errors import DataError
from palpate.volumes.metrics import contrast_to_noise, nmse

RNG = np.random.default_rng(0)
TRUTH = RNG.random((4, 5, 6)) + 0.5
NOISY = TRUTH + 0.1 * RNG.standard_normal(TRUTH.shape)
REGION = np.zeros(TRUTH.shape, bool)
REGION[1:3, 1:4, 2:5] = True


def test_the_truth_has_no_error_and_nothing_has_an_error_of_one():
    assert nmse(TRUTH, TRUTH) == 0
    assert nmse(0 * TRUTH, TRUTH) == 1
    assert nmse(1.1 * TRUTH, TRUTH) == pytest.approx(0.01)


@given(gain=st.floats(0.1, 10), offset=st.floats(-5, 5))
def test_window_and_level_do_not_change_the_scaled_error(gain, offset):
    expected = 1 - np.corrcoef(NOISY.ravel(), TRUTH.ravel())[0, 1] ** 2
    assert nmse(gain * NOISY + offset, TRUTH, scaled=True) == pytest.approx(expected, rel=1e-6)


def test_only_the_region_counts():
    spoilt = np.where(REGION, NOISY, 99)
    for scaled in (False, True):
        assert nmse(spoilt, TRUTH, REGION, scaled) == nmse(NOISY, TRUTH, REGION, scaled) > 0


@given(gain=st.floats(0.1, 10), offset=st.floats(-5, 5))
def test_contrast_to_noise_is_known_for_known_noise_and_free_of_scale(gain, offset):
    values = np.where(REGION, 7.0, NOISY - TRUTH)
    expected = (7 - values[~REGION].mean()) / values[~REGION].std()
    assert contrast_to_noise(gain * values + offset, REGION, ~REGION) == pytest.approx(expected, rel=1e-6)


REFUSED = {
    "shape": (lambda: nmse(TRUTH[1:], TRUTH), ["values", "(4, 5, 6)", "(3, 5, 6)"]),
    "region": (lambda: nmse(TRUTH, TRUTH, REGION[1:]), ["region", "(4, 5, 6)", "(3, 5, 6)"]),
    "dtype": (lambda: nmse(TRUTH, TRUTH, TRUTH), ["region", "bool", "float64"]),
    "empty": (lambda: nmse(TRUTH, TRUTH, REGION & ~REGION), ["region", "no voxel", "mark"]),
    "zero truth": (lambda: nmse(TRUTH, 0 * TRUTH), ["truth is 0", "choose another region"]),
    "flat truth": (lambda: nmse(TRUTH, 0 * TRUTH + 1, scaled=True), ["truth is constant", "choose another region"]),
    "flat background": (lambda: contrast_to_noise(REGION * 1.0, REGION, ~REGION), ["outside is constant"]),
    "overlap": (lambda: contrast_to_noise(TRUTH, REGION, REGION), ["overlap in 18 voxels", "erode"]),
    "NaN": (lambda: nmse(TRUTH * np.nan, TRUTH), ["values", "nan"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_name_value_and_remedy(case):
    act, words = REFUSED[case]
    with pytest.raises(DataError) as refusal:
        act()
    for word in words:
        assert word in str(refusal.value)
