"""Derivatives of the force on a tool: against finite differences of the models, which know no derivatives."""

import numpy as np
import pytest
from support.scan_and_organ import lumpy

import palpate as pp
from palpate.differentiable.push_response import PushResponse
from palpate.errors import DataError, MaterialError

YOUNG = np.array([5.0, 40.0])  # kPa of regions 3 and 7
POINTS = np.array([[20.0, 25, 50], [38, 25, 50]])
PUSHES = np.array([[0.3, -0.2, -2.0], [0.1, 0.4, -1.0]])
WEIGHTS = np.array([[0.2, -1.0, 0.7], [1.5, 0.3, -0.4]])


def force(element, pushes, young):
    """Of a tissue made with these moduli, by the public solver."""
    tissue = lumpy(element).replace(young=dict(zip((3, 7), young, strict=True)))
    return pp.finite_elements(tissue).push(POINTS, pushes, 9).force


@pytest.fixture(scope="module", params=["smoothed", "P1"])
def element(request):
    return request.param


@pytest.fixture(scope="module")
def response(element):
    return PushResponse(lumpy(element), POINTS, 9)


def test_the_force_is_that_of_the_models(element, response):
    assert response.regions.tolist() == [3, 7]
    found = response.force(PUSHES, YOUNG)
    np.testing.assert_allclose(found, force(element, PUSHES, YOUNG), rtol=1e-12)
    tissue = lumpy(element).replace(young={3: 5.0, 7: 40.0})
    pushed = pp.model(tissue, "compliance").push(POINTS, PUSHES, 9)
    np.testing.assert_allclose(found, pushed.force, rtol=1e-8, atol=1e-10)


def test_derivatives_by_displacement_against_differences(element, response):
    by_displacement, _ = response.gradient(PUSHES, YOUNG, WEIGHTS)
    differences = np.empty_like(PUSHES)
    for i in np.ndindex(PUSHES.shape):
        step = np.zeros_like(PUSHES)
        step[i] = 0.5  # the force is linear in it
        apart = force(element, PUSHES + step, YOUNG) - force(element, PUSHES - step, YOUNG)
        differences[i] = (WEIGHTS * apart).sum()
    np.testing.assert_allclose(by_displacement, differences, rtol=1e-8)


def test_derivatives_by_stiffness_against_differences(element, response):
    _, by_young = response.gradient(PUSHES, YOUNG, WEIGHTS)
    for r, h in enumerate(1e-4 * YOUNG):
        step = h * (np.arange(2) == r)
        apart = force(element, PUSHES, YOUNG + step) - force(element, PUSHES, YOUNG - step)
        assert by_young[r] == pytest.approx((WEIGHTS * apart).sum() / (2 * h), rel=1e-6)


def test_force_grows_in_proportion_when_all_stiffen(response):
    """Euler's theorem: F is homogeneous of degree 1 in the moduli."""
    _, by_young = response.gradient(PUSHES, YOUNG, WEIGHTS)
    assert by_young @ YOUNG == pytest.approx((WEIGHTS * response.force(PUSHES, YOUNG)).sum(), rel=1e-9)


def test_one_contact_keeps_its_shape(element, response):
    single = PushResponse(lumpy(element), POINTS[0], 9)
    by_displacement, by_young = single.gradient(PUSHES[0], YOUNG, WEIGHTS[0])
    assert single.force(PUSHES[0], YOUNG).shape == by_displacement.shape == (3,)
    assert by_young.shape == (2,)


def test_what_cannot_be_is_refused(response):
    with pytest.raises(MaterialError, match='element: "P2" has no derivative'):
        PushResponse(lumpy("P2"), POINTS, 9)
    with pytest.raises(DataError, match="off the surface"):
        PushResponse(lumpy(), (25, 25, 90), 9)
    with pytest.raises(DataError, match=r"young: expected shape \(2\), got \(3,\)"):
        response.force(PUSHES, [1, 2, 3])
    with pytest.raises(MaterialError, match="young: -1 kPa"):
        response.force(PUSHES, [5, -1])
    with pytest.raises(DataError, match=r"displacements: expected shape \(2, 3\)"):
        response.force(PUSHES[0], YOUNG)
