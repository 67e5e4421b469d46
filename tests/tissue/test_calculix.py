"""CalculiX solves the same pushes with its own elements, assembly and solver, and gets the same answers."""

import os

import numpy as np
import pytest
from support.calculix import FOUR_POINTS, MISSING, SPLIT, apart, calculix, cube, there

import palpate as pp
from palpate.tissue.reference.finite_strain import FiniteStrain

TOP, PUSH, RADIUS = np.array([25.0, 25.0, 50.0]), np.array([1.0, 0.0, -5.0]), 18.0


@pytest.fixture(autouse=True)
def installed():
    if not there():
        (pytest.fail if os.environ.get("PALPATE_REQUIRE_CALCULIX") == "1" else pytest.skip)(MISSING)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_linear_elements_agree_with_calculix_to_its_printed_digits(element):
    tissue = cube(5)
    ours = pp.finite_elements(tissue, element).push(TOP, PUSH, RADIUS)
    u, force = apart(calculix(tissue, element, TOP, PUSH, RADIUS, finite=False), ours)
    assert 0 < u < 1e-6
    assert force < 1e-6


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_finite_strain_agrees_with_calculix_on_its_own_energy(element):
    tissue = cube(5)
    ours = FiniteStrain(tissue, element, SPLIT, FOUR_POINTS[element]).push(TOP, PUSH, RADIUS)
    u, force = apart(calculix(tissue, element, TOP, PUSH, RADIUS, finite=True), ours)
    assert 0 < u < 1e-6
    assert force < 1e-6
    linear = pp.finite_elements(tissue, element).push(TOP, PUSH, RADIUS)
    assert np.linalg.norm(linear.force - ours.force) > 0.02 * np.linalg.norm(ours.force)  # the strain is finite


def test_the_energies_are_alike_where_strain_is_small_and_volumes_nearly_kept():
    """Ours and CalculiX's neo-Hookean laws have the same linear limit: at a small push they nearly agree."""
    tissue = cube(5)
    ours = pp.finite_strain(tissue, "P1").push(TOP, PUSH / 50, RADIUS)
    _, force = apart(calculix(tissue, "P1", TOP, PUSH / 50, RADIUS, finite=True), ours)
    assert 1e-6 < force < 5e-3
