"""What a scan holds and what it refuses."""

import numpy as np
import pytest

import palpate as pp
from palpate.errors import DataError

VIEWS = pp.circular_views(pp.Panel((5, 6), (1, 1), (-2.5, -2, 0)), radius=100, height=500, count=3)
COUNTS = np.arange(90.0).reshape(3, 5, 6)


@pytest.mark.parametrize(
    ("given", "full"),
    [
        (7, np.full((3, 5, 6), 7)),
        ([1, 2, 3], np.repeat([1, 2, 3], 30).reshape(3, 5, 6)),
        (np.arange(1, 31).reshape(1, 5, 6), np.tile(np.arange(1, 31).reshape(1, 5, 6), (3, 1, 1))),
        (COUNTS + 1, COUNTS + 1),
    ],
)
def test_incident_and_background_broadcast_per_view_or_per_pixel(given, full):
    scan = pp.Scan(COUNTS, given, VIEWS, background=given)
    assert np.array_equal(scan.incident, full)
    assert np.array_equal(scan.background, full)


def test_views_of_a_scan_can_be_chosen_together_with_their_counts():
    scan = pp.Scan(COUNTS, [10, 20, 30], VIEWS)[1:]
    assert scan.shape == (2, 5, 6)
    assert np.array_equal(scan.counts, COUNTS[1:])
    assert scan.incident[0, 0, 0] == 20
    assert np.array_equal(scan.views.source, VIEWS.source[1:])


def test_a_scan_does_not_change():
    with pytest.raises(ValueError, match="read-only"):
        pp.Scan(COUNTS, 10, VIEWS).counts[0, 0, 0] = 1


def test_pixels_that_measured_nothing_may_hold_anything_finite():
    mask = np.ones((3, 5, 6), bool)
    mask[1, 2, 3] = False
    counts, incident = COUNTS.copy(), np.full((3, 5, 6), 9.0)
    counts[1, 2, 3], incident[1, 2, 3] = -4, 0
    assert not pp.Scan(counts, incident, VIEWS, mask=mask).mask[1, 2, 3]


def spoilt(value, dtype=np.float64):
    counts = COUNTS.astype(dtype)
    counts[1, 2, 3] = value
    return counts


REFUSED = {
    "shape": (lambda: pp.Scan(COUNTS[:2], 9, VIEWS), ["counts", "(3, 5, 6)", "(2, 5, 6)"]),
    "dtype": (lambda: pp.Scan(COUNTS.astype(complex), 9, VIEWS), ["counts", "complex128", "astype"]),
    "text": (lambda: pp.Scan(COUNTS.astype(str), 9, VIEWS), ["counts", "real numbers", "astype"]),
    "NaN": (lambda: pp.Scan(spoilt(np.nan), 9, VIEWS), ["counts", "(1, 2, 3)", "nan", "mask or replace"]),
    "negative": (lambda: pp.Scan(spoilt(-2), 9, VIEWS), ["counts", "view 1, row 2, column 3: -2", "offset"]),
    "zero incident": (lambda: pp.Scan(COUNTS, [9, 0, 9], VIEWS), ["incident", "30 measured", "view 1", "mask"]),
    "negative background": (lambda: pp.Scan(COUNTS, 9, VIEWS, -1), ["background", "-1", "below 0"]),
    "incident shape": (lambda: pp.Scan(COUNTS, [9, 9], VIEWS), ["incident", "(3,)", "(2,)"]),
    "mask dtype": (lambda: pp.Scan(COUNTS, 9, VIEWS, mask=np.ones(3)), ["mask", "bool", "float64"]),
    "mask shape": (lambda: pp.Scan(COUNTS, 9, VIEWS, mask=np.ones(4, bool)), ["mask", "(4,)", "(3, 5, 6)"]),
    "empty mask": (lambda: pp.Scan(COUNTS, 9, VIEWS, mask=np.array(False)), ["mask", "no pixel", "True marks"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_name_value_and_remedy(case):
    act, words = REFUSED[case]
    with pytest.raises(DataError) as refusal:
        act()
    for word in words:
        assert word in str(refusal.value)
