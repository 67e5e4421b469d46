"""The told error of linear strain, against pushes at finite strain by separate code; and what has none."""

import numpy as np
import pytest
from support.brick_meshes import block, brick

import palpate as pp

TOP, RADIUS = np.array([25.0, 25.0, 50.0]), 12.0
PUSHES = [(0, 0, -3.0), (0, 0, -10.0), (0, 0, 10.0), (9.0, 0, -3.0), (0, 0, -15.0)]


def difference(linear, finite, push):
    """Of the forces, over that at finite strain; negative if the linear one resists the push less."""
    return np.copysign(np.linalg.norm(linear - finite) / np.linalg.norm(finite), -((linear - finite) @ push))


@pytest.mark.parametrize("element", ["P1", "smoothed"])
@pytest.mark.parametrize("poisson", [0.3, 0.45])
def test_it_is_the_difference_from_finite_strain(poisson, element):
    """`finite_strain` is Newton's method in Python."""
    tissue = block(5, poisson=poisson, element=element)
    model, truth = pp.model(tissue, "compliance"), pp.finite_strain(tissue)
    for push in PUSHES:
        answer = model.push(TOP, push, RADIUS)
        finite = truth.push(TOP, push, RADIUS).force
        expected = difference(answer.force, finite, push)
        assert answer.estimate.linearisation == pytest.approx(expected, abs=0.015)


def test_its_sign_and_its_limit_are_right():
    """Of random pushes where both differ by more than a tenth, it says so, and in which direction."""
    rng, right, judged = np.random.default_rng(3), 0, 0
    mesh = brick((5, 5, 5))
    for _ in range(30):
        tissue = pp.Tissue(mesh, 5.0, rng.uniform(0.3, 0.48), mesh.nodes[:, 2] == 0)
        point = np.array([*rng.uniform(12, 38, 2), 50.0])
        push = rng.uniform(4, 15) * np.array([*rng.uniform(-0.7, 0.7, 2), rng.choice([-1.0, 1.0])])
        answer = pp.model(tissue, "compliance").push(point, push, RADIUS)
        finite = pp.model(tissue, "neo-hookean").push(point, push, RADIUS, tolerance=1e-4).force
        error = difference(answer.force, finite, push)
        if abs(error) > 0.1:
            judged += 1
            told = answer.estimate.linearisation
            right += (told > 0) == (error > 0) and abs(told) > 0.09
    assert judged >= 5
    assert right >= 0.95 * judged


def test_elements_that_linear_strain_turns_over_are_seen():
    model = pp.model(block(7, poisson=0.3), "compliance")
    for depth, turned in ((2.0, False), (20.0, True)):
        least = model.linearisation.least_volume(model.push(TOP, (0, 0, -depth), 8.0).displacement)
        assert (least < 0) == turned


def test_what_finite_strain_cannot_answer_is_unknown():
    estimate = pp.model(block(5), "compliance").push(TOP, (0, 0, -60.0), RADIUS).estimate
    assert np.isnan(estimate.linearisation)
    assert np.isfinite(estimate.mesh)


def test_models_without_factors_have_none():
    assert pp.model(block(5), "multigrid").push(TOP, (0, 0, -3.0), RADIUS).estimate.linearisation is None


def test_more_contacts_than_a_loop_has_tools_have_none():
    many = [[x, y, 50.0] for x in (10.0, 40.0) for y in (10.0, 25.0, 40.0)]
    estimate = pp.model(block(7), "compliance").push(many, [[0, 0, -1.0]] * 6, 6.0).estimate
    assert estimate.linearisation is None
    assert np.isfinite(estimate.total)
