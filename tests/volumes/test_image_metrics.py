"""Errors and contrast of volumes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.errors import DataError
from palpate.volumes.image_metrics import artefact_spread, contrast_to_noise, nmse, structural_similarity, width_at_half

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


SLICES = np.random.default_rng(1).random((3, 16, 20))
INSERT = np.zeros((5, 6), bool)
INSERT[1:3, 1:4] = True


def test_the_truth_is_like_itself_and_noise_is_not():
    assert structural_similarity(SLICES, SLICES) == pytest.approx(1)
    assert abs(structural_similarity(np.random.default_rng(2).random(SLICES.shape), SLICES)) < 0.1


@given(a=st.floats(0, 3), b=st.floats(0, 3))
def test_flat_slices_are_as_alike_as_their_brightness(a, b):
    """Without variance SSIM is (2ab + C) / (a² + b² + C), C = (0.01 · range)²; another slice gives the range."""
    truth = np.full((2, 12, 12), b)
    truth[1, 0, 0] = b + 2
    values = np.full(truth.shape, a)
    c = 0.02**2
    region = np.zeros(truth.shape, bool)
    region[0] = True
    region[1, 0, 0] = True
    values[1], flat = truth[1], (2 * a * b + c) / (a * a + b * b + c)
    assert structural_similarity(values, truth, region) == pytest.approx((144 * flat + 1) / 145, rel=1e-9)


@given(gain=st.floats(0.1, 10), offset=st.floats(-5, 5))
def test_what_an_insert_leaks_is_known_where_it_is_separable(gain, offset):
    leak = np.array([0.1, 0.4, 1.0, 0.5, -0.2])
    background = np.arange(5.0)  # of a slice: no concern of the insert
    values = gain * (leak[:, None, None] * INSERT + background[:, None, None]) + offset
    np.testing.assert_allclose(artefact_spread(values, INSERT, ~INSERT, 2), leak, atol=1e-9)
    np.testing.assert_allclose(artefact_spread(values, INSERT, ~INSERT, 3), leak / 0.5, atol=1e-9)


def test_width_at_half_of_a_triangle_and_of_a_gaussian():
    assert width_at_half([0, 1, 2, 3, 4, 3, 2, 1, 0], 0.5) == pytest.approx(2)
    assert width_at_half([1.2, 4, 0], 2) == pytest.approx(2 * (2 / 2.8 + 0.5))
    z = np.arange(-30, 31) * 0.25
    assert width_at_half(np.exp(-(z**2) / 8), 0.25) == pytest.approx(2 * 2 * np.sqrt(2 * np.log(2)), rel=1e-3)
    assert width_at_half([4, 4, 4], 1) == 2  # never falls: as far as there are samples


REFUSED = {
    "small slices": (lambda: structural_similarity(TRUTH, TRUTH), ["11 x 11", "(5, 6)"]),
    "no range": (lambda: structural_similarity(0 * SLICES, 0 * SLICES), ["truth is constant", "choose another region"]),
    "no such slice": (lambda: artefact_spread(TRUTH, INSERT, ~INSERT, 4), ["at", "4", "0 to 3"]),
    "shadows overlap": (lambda: artefact_spread(TRUTH, INSERT, INSERT, 1), ["overlap in 6 pixels"]),
    "no contrast": (lambda: artefact_spread(0 * TRUTH, INSERT, ~INSERT, 1), ["no contrast in slice 1"]),
    "no half": (lambda: width_at_half([-1, -2], 1), ["maximum is not above 0"]),
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
