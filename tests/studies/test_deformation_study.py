"""`palpate study deformation --quick`: its numbers computed again by other means, from the files that it leaves."""

import csv
import html
import json
import re

import numpy as np
import pytest
import skfem
from skfem.models.elasticity import lame_parameters, linear_elasticity
from support.running_server import ended, interrupted, start

import palpate as pp
from palpate.errors import FileError
from palpate.report.stages import Stages
from palpate.studies.deformation.config import QUICK, cube, tissue
from palpate.studies.deformation.haptic_fidelity import work
from palpate.studies.deformation.readings import searched
from palpate.studies.deformation.run_store import run_all

pytestmark = pytest.mark.slow
LAWS = ("uniform 0.03", "uniform 0.5", "linear", "exponential")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("deformation")
    code, out, err = ended("study deformation --quick -o study --docs docs", folder)
    assert code == 0, err
    assert str(folder / "study" / "report.html") in out
    return folder / "study"


@pytest.fixture(scope="module")
def report(study):
    """The report's words."""
    return html.unescape(re.sub("<[^>]+>", " ", (study / "report.html").read_text()))


def table(study, name, **wanted):
    """Rows of a table with these values."""
    with (study / "tables" / f"{name}.csv").open(newline="") as file:
        return [r for r in csv.DictReader(file) if all(r[k] == str(v) for k, v in wanted.items())]


def columns(rows, *names):
    return np.array([[float(row[name]) for name in names] for row in rows])


def moved(rows, who):
    return columns(rows, f"{who}:x", f"{who}:y", f"{who}:z")


def test_every_figure_is_in_the_report_and_says_its_command(study, report):
    pictures = sorted((study / "figures").glob("*.png"))
    text = (study / "report.html").read_text()
    captions = re.findall("<figcaption>(.*?)</figcaption>", text)
    assert len(pictures) == len(captions) == text.count("data:image/png;base64") >= 16
    assert all(caption.endswith("Made by: palpate study deformation --quick") for caption in captions)
    for word in ("RSC0", "irregular", "Truth Cube", "blocks", "certified bound", "thrown", "deformed 30 times"):
        assert word in report
    page = study.parent / "docs" / "deformation.md"
    links = re.findall(r"\]\((images/[^)]+)\)", page.read_text())
    assert len(links) == len(pictures)
    assert all((page.parent / link).stat().st_size > 1000 for link in links)


def test_the_truth_is_what_scikit_fem_alone_gives(study):
    """Quadratic elements, the three nodes of the touched triangle and the middles between them moved 5 mm down."""
    mesh = cube(QUICK.main)
    for poisson in QUICK.ratios:
        rows = table(study, "profiles", poisson=poisson)
        tets = skfem.MeshTet(mesh.nodes.T, mesh.tets.T.astype(np.int64), sort_t=False)
        space = skfem.Basis(tets, skfem.ElementVector(skfem.ElementTetP2()), intorder=4)
        K = linear_elasticity(*lame_parameters(5e-3, poisson)).assemble(space)
        u = np.zeros(space.N)
        fem = moved(rows, "fem")
        touched = np.flatnonzero(fem[:, 2] < -4.999)
        assert len(touched) == 3
        middles = space.edge_dofs[:, np.isin(tets.edges, touched).all(axis=0)]
        imposed = np.concatenate([space.nodal_dofs[:, touched], middles], axis=1)
        u[imposed[2]] = -5.0
        held = space.get_dofs(lambda x: x[2] == 0).all()
        solved = skfem.solve(*skfem.condense(K, np.zeros(space.N), u, D=np.union1d(held, imposed.ravel())))
        np.testing.assert_allclose(fem, solved[space.nodal_dofs].T, atol=5e-6)


def rings(mesh, first):
    """Row of each node, by a walk of our own: 1 at the contact."""
    row, front = np.zeros(len(mesh.nodes), int), set(first)
    pairs = np.concatenate([mesh.tets[:, [a, b]] for a in range(4) for b in range(4) if a != b])
    number = 1
    while front:
        row[list(front)] = number
        front = set(pairs[np.isin(pairs[:, 0], list(front)), 1].tolist()) - set(np.flatnonzero(row).tolist())
        number += 1
    return row


def test_springs_are_in_balance_by_the_laws_as_they_are_written(study):
    """Σ (u_j − u_i) = RSC(row) u_i at every node that is neither held nor touched; equal edges."""
    mesh = cube(QUICK.main)
    rows = table(study, "profiles", poisson=0.3)
    touched = np.flatnonzero(moved(rows, "fem")[:, 2] < -4.999)
    row = rings(mesh, touched.tolist())
    pairs = np.unique(np.concatenate([mesh.tets[:, [a, b]] for a in range(4) for b in range(4) if a != b]), axis=0)
    free = np.setdiff1d(np.flatnonzero(mesh.nodes[:, 2] > 0), touched)
    for law in LAWS:
        found = moved(rows, law)
        if law.startswith("uniform"):
            home = np.full(len(row), float(law.split()[1]))
        else:
            (best,) = table(
                study, "optimum", contact="triangle", weights="equal", law=law, poisson=0.3, least="worst_mm"
            )
            size = float(best["rsc"])
            home = size * row if law == "linear" else 1 - np.exp(-size * row)
        pull = np.zeros_like(found)
        np.add.at(pull, pairs[:, 0], found[pairs[:, 1]] - found[pairs[:, 0]])
        np.testing.assert_allclose((pull - home[:, None] * found)[free], 0, atol=2e-4)
        np.testing.assert_allclose(found[touched], [[0, 0, -5]] * 3, atol=1e-6)


def test_errors_follow_from_the_nodes(study):
    for poisson in QUICK.ratios:
        rows = table(study, "profiles", poisson=poisson)
        gap = np.linalg.norm(moved(rows, "exponential") - moved(rows, "fem"), axis=1)
        (best,) = table(
            study, "optimum", contact="triangle", weights="equal", law="exponential", poisson=poisson, least="worst_mm"
        )
        assert float(best["worst_mm"]) == pytest.approx(gap.max(), abs=1e-4)
        assert float(best["rms_mm"]) == pytest.approx(np.sqrt((gap**2).mean()), abs=1e-4)
        curve = table(study, "rsc", contact="triangle", weights="equal", law="exponential", poisson=poisson)
        assert len(curve) == QUICK.steps
        assert float(best["worst_mm"]) <= min(float(r["worst_mm"]) for r in curve) + 1e-9


def direct_springs(mesh, held, touched, home):
    """(N,) displacement along z of equal edge springs with `home` (N,) RSC, `touched` moved by 1: a dense solution."""
    pairs = np.unique(np.concatenate([mesh.tets[:, [a, b]] for a in range(4) for b in range(4) if a != b]), axis=0)
    K = np.zeros((len(mesh.nodes),) * 2)
    K[tuple(pairs.T)] = -1.0
    K += np.diag(home - K.sum(axis=1))
    u = np.zeros(len(mesh.nodes))
    u[touched] = 1.0
    free = np.flatnonzero(~held & (u == 0))
    u[free] = np.linalg.solve(K[np.ix_(free, free)], -(K @ u)[free])
    return u


def test_a_reading_of_a_single_node_has_the_least_error_of_the_searched_list(study):
    """Springs by a dense solution, elements by scikit-fem alone; sides held, RMS."""
    mesh = cube(QUICK.main)
    x = mesh.nodes
    held = (np.abs(x[:, :2] - 25) == 25).any(axis=1)
    touched = np.argmin(np.linalg.norm(x - [25, 25, 50], axis=1))
    tets = skfem.MeshTet(x.T, mesh.tets.T.astype(np.int64), sort_t=False)
    space = skfem.Basis(tets, skfem.ElementVector(skfem.ElementTetP2()), intorder=4)
    K = linear_elasticity(*lame_parameters(5e-3, 0.3)).assemble(space)
    still = held[tets.edges].all(axis=0)  # an edge between two held nodes is held
    fixed = np.concatenate([space.nodal_dofs[:, held].ravel(), space.edge_dofs[:, still].ravel()])
    u = np.zeros(space.N)
    imposed = space.nodal_dofs[:, touched]
    u[imposed[2]] = -5.0
    true = skfem.solve(*skfem.condense(K, np.zeros(space.N), u, D=np.union1d(fixed, imposed)))[space.nodal_dofs].T
    row, sizes = rings(mesh, [touched]), searched(QUICK)
    laws = {
        "linear": lambda s: s * row,
        "exponential": lambda s: 1 - np.exp(-s * row),
        "uniform": lambda s: s + 0 * row,
    }
    error = {law: [] for law in laws}
    for law, home in laws.items():
        for size in sizes:
            z = -5 * direct_springs(mesh, held, [touched], home(size))
            gap = np.linalg.norm(np.stack([0 * z, 0 * z, z], axis=1) - true, axis=1)
            error[law].append(np.sqrt((gap**2).mean()))
    error["both"] = np.maximum(error["linear"], error["exponential"])
    for law in ("linear", "exponential", "both"):
        (best,) = table(study, "readings", contact="node", support="sides", measure="RMS", law=law, poisson=0.3)
        at = np.argmin(np.abs(sizes + float(best["rsc"])))
        assert error[law][at] == pytest.approx(float(best["error_mm"]), abs=2e-4)
        assert error[law][at] <= min(error[law]) + 2e-4
        assert float(best["uniform_mm"]) == pytest.approx(min(error["uniform"]), abs=2e-4)


def test_every_reading_is_in_the_report(study, report):
    rows = table(study, "readings")
    assert len(rows) == 3 * 3 * 3 * 3 * len(QUICK.ratios)
    assert "tried on 81 readings of the set-up" in report
    for support in ("bottom", "sides", "all but top"):
        assert len(re.findall(rf"(?:node|triangle|patch)\s+{support}\s+(?:worst|RMS|mean)", report)) == 27


def test_the_table_of_rows_lists_the_rings_of_the_coarsest_cube(study, report):
    mesh = cube(QUICK.sizes[0])
    listed = [list(map(int, row["members"].split())) for row in table(study, "row_table")]
    row = rings(mesh, listed[0])
    assert len(listed) > 2
    for k, members in enumerate(listed):
        assert members == np.flatnonzero(row == k + 1).tolist()
    reach = table(study, "reach", nodes=QUICK.main, still_mm=0.1)
    assert re.search(rf"{reach[0]['rows']} of \d+\s+{reach[0]['nodes_in_table']} of {QUICK.main**3}", report)


def test_sweeps_end_where_springs_and_elements_solved_by_other_means_are(study):
    for nodes in QUICK.sizes:
        for name in {row["model"] for row in table(study, "convergence", nodes=nodes)}:
            error = columns(table(study, "convergence", nodes=nodes, model=name), "error")[:, 0]
            assert error[-1] < 1e-6
            assert error[-1] <= error[0]
    for row in table(study, "stability"):
        assert float(row["after_1024_mm"]) < 1e-3
        assert float(row["shaken_mm"]) < 4 * float(row["shake_mm"])


def test_the_ladder_is_judged_by_a_direct_solution(study):
    solid = tissue(QUICK.ladder[0], 0.45)
    assert solid.mesh.tets.shape[0] == 6 * 5**3
    for row in table(study, "pareto"):
        if row["model"] == "blocks" and float(row["tolerance"]) <= 1e-3:
            assert float(row["error"]) < 1e-3
            assert float(row["force_error"]) < 1e-3
        if row["model"] == "springs":
            assert float(row["error"]) > 0.05  # no law makes a finite element of a spring
    rows = table(study, "needed", truth="P1, linear strain")
    for row in rows:
        enough = float(row["displacement"]) <= float(row["within_mm"]) and float(row["force"]) <= float(
            row["within_force"]
        )
        assert (row["enough"] == "True") == enough
    assert [row["enough"] for row in rows if row["name"] == "blocks"] == ["True"]


def test_ripple_in_the_report_is_that_of_the_forces(study, report):
    for radius in QUICK.radii:
        for name in ("springs", "blocks", "finite elements"):
            force = columns(table(study, "ripple", radius_edges=radius, model=name), "force_n")[:, 0]
            assert len(force) == QUICK.points
            s = np.linspace(0, 1, len(force))
            rest = (
                force - np.stack([s**0, s, s**2], axis=1) @ np.linalg.lstsq(np.stack([s**0, s, s**2], axis=1), force)[0]
            )
            assert f"{name} {100 * np.ptp(rest) / force.mean():.2f} %" in report


def test_a_contact_that_stays_gives_no_work(study):
    glued = [r for r in table(study, "loops") if "slide" not in r["path"]]
    assert len(glued) >= 12
    for row in glued:
        assert float(row["net_nmm"]) >= -0.01 * float(row["stored_nmm"])


def test_work_of_fields_that_are_known():
    s = np.linspace(0, 2 * np.pi, 2001)
    circle = 3 * np.stack([np.cos(s), np.sin(s), 0 * s], axis=1)
    still = np.zeros_like(circle)
    assert work(still, circle, -2 * circle)[0] == pytest.approx(0, abs=1e-9)  # a spring
    whirl = np.stack([-circle[:, 1], circle[:, 0], 0 * s], axis=1)
    assert work(still, circle, whirl)[0] == pytest.approx(-2 * np.pi * 9, rel=1e-5)  # −∮ F·dx, twice the area
    assert work(still, circle, -2 * circle)[1] == pytest.approx(9)  # ½ k r²


def test_resuming_makes_only_what_is_missing(study):
    paths = sorted((study / "runs").iterdir())
    before = {path: path.stat().st_mtime_ns for path in paths}
    lost = study / "runs" / "profiles.json"
    kept = json.loads(lost.read_text())
    lost.unlink()
    run_all(Stages(study, resume=True), QUICK, lambda what, share: None)
    assert {path for path in paths if path.stat().st_mtime_ns != before[path]} == {lost}
    assert json.loads(lost.read_text()) == kept


def test_another_study_is_not_mixed_in(study):
    with pytest.raises(FileError, match="--quick"):
        pp.deformation_study(study, resume=True)


def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(tmp_path):
    process = start("study deformation --quick -o study", tmp_path)
    runs = tmp_path / "study" / "runs"
    code, _, err = interrupted(process, lambda: len(list(runs.glob("truth-*.npz"))) > 1)
    assert code == 130
    assert "palpate study deformation --resume --quick -o study" in err
    assert not list((tmp_path / "study").rglob(".*.part-*"))
    for path in runs.glob("*.json"):
        json.loads(path.read_text())
