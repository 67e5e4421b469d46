"""The model that `touch` begins with: the most exact one that is in time, by trial."""

import numpy as np
import pytest
from support.example_organs import organ

import palpate as pp
from palpate.simulation import starting_model as selection


@pytest.fixture(scope="module")
def tissue():
    return organ(7)


@pytest.mark.parametrize(
    ("milliseconds", "expected", "said"),
    [
        ({"compliance": 0.02}, "compliance", "take at most 0.02 ms here, in time for 1000 a second"),
        ({"compliance": 1.2, "multigrid": 0.9}, "multigrid", "compliance needs 1.2 ms"),
        ({"compliance": np.inf, "multigrid": 1.1, "blocks": 0.8}, "blocks", "compliance needs over 10 ms"),
        ({"compliance": 7, "multigrid": 3, "blocks": 5, "springs": 1.3}, "springs", "none keeps 1000 ticks a second"),
        ({"compliance": 7, "multigrid": 3, "blocks": 5, "springs": 4}, "multigrid", "a coarser mesh can"),
    ],
)
def test_the_most_exact_model_in_time_is_selected_else_the_quickest(monkeypatch, tissue, milliseconds, expected, said):
    timed = []

    def tick_seconds(model, radius):
        timed.append(pp.tissue.models.registry.name_of(model))
        return milliseconds[timed[-1]] / 1e3

    monkeypatch.setattr(selection, "tick_seconds", tick_seconds)
    found = selection.starting_model(tissue)
    assert type(found.model) is type(pp.model(tissue, expected))
    assert found.reason.startswith(f"{expected} (")
    assert said in found.reason
    assert timed == list(milliseconds)  # no more than needed


def test_what_takes_too_long_to_make_is_not_made(monkeypatch, tissue):
    monkeypatch.setattr(selection, "MOST_NODES", 100)
    monkeypatch.setattr(selection, "tick_seconds", lambda model, radius: 1e-4)
    found = selection.starting_model(tissue)
    assert found.reason.startswith("multigrid (")
    assert "compliance takes too long to make for more than 100 nodes" in found.reason


def test_what_cannot_be_made_is_told_with_its_reason(monkeypatch, tissue):
    monkeypatch.setattr(selection, "tick_seconds", lambda model, radius: 1e-4)

    def model(tissue, name):
        if name == "compliance":
            raise error
        return pp.model(tissue, name)

    monkeypatch.setattr(selection, "model", model)
    for error in (pp.errors.MaterialError("not positive definite"), pp.errors.DataError("too many gaps")):
        found = selection.starting_model(tissue)
        assert found.reason.startswith("multigrid (")
        assert f"compliance: {error}" in found.reason


def test_a_model_in_which_organs_go_through_each_other_says_so(monkeypatch, tissue):
    moved = pp.TetMesh(tissue.mesh.nodes + (81, 0, 0), tissue.mesh.tets, tissue.mesh.region, tissue.mesh.names)
    both = pp.join_tissues([tissue, tissue.replace(mesh=moved)])
    monkeypatch.setattr(selection, "MOST_NODES", 100)
    monkeypatch.setattr(selection, "tick_seconds", lambda model, radius: 1e-4)
    assert "multigrid lets organs, and lips of cuts, go through each other" in selection.starting_model(both).reason
    assert "go through" not in selection.starting_model(tissue).reason


def test_a_trial_times_every_tick_of_a_real_stroke(tissue):
    """The stroke stays on the surface and is felt; its time is that of the loop's own tally."""
    ticks = list(range(0, 500, 16))
    commands = selection.stroke(tissue, 10.0, ticks)
    points = np.array([command.point for command in commands])
    assert np.ptp(points, axis=0).max() > 5
    for command in commands:
        np.testing.assert_allclose(tissue.surface.closest(np.array(command.point)).point, command.point, atol=1e-9)
    with pp.Session(pp.model(tissue, "compliance"), radius=10.0) as session:
        force = session.step(commands)
    assert (np.linalg.norm(force, axis=1) > 0).all()
    assert 0 < selection.tick_seconds(pp.model(tissue, "compliance"), 10.0) <= np.inf
