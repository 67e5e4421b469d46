"""Named tissues: the table, its page, and meshes whose regions are named tissues."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from support.brick_meshes import brick
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import DataError, MaterialError
from palpate.tissue.named_tissues import material_lines, named_materials, poisson_of, tissue_list, young_of
from palpate.tissue.tissue import constant_per_tet
from palpate.tissue.tissue_properties import QUANTITIES
from palpate.tissue.tissue_table import TISSUES

DOCS = Path(__file__).parents[2] / "docs"
PLAIN = brick((4, 4, 4), region=lambda c: np.where(c[:, 2] > 30, 2, 1))
MESH = pp.TetMesh(PLAIN.nodes, PLAIN.tets, PLAIN.region, {1: "organ", 2: "lump"})
BOTTOM = MESH.nodes[:, 2] == 0
FOUND = [(t.name, q, m) for t in TISSUES.values() for q in QUANTITIES if (m := t.measured(q)) is not None]


def per_tet(quantity, given, tissue):
    complete = {"young": young_of, "poisson": poisson_of}[quantity]
    return constant_per_tet(quantity, complete(MESH, given, named_materials(MESH, tissue)), MESH)


def by_region(organ, lump):
    return np.where(MESH.region == 2, lump, organ)


def test_the_tissues_that_people_ask_for_are_there():
    assert {"skin", "fat", "gland", "muscle", "liver", "kidney", "spleen", "lung", "vessel", "bowel"} < set(TISSUES)
    assert {"breast-carcinoma", "liver-carcinoma", "fibroadenoma"} < set(TISSUES)


@pytest.mark.parametrize(("name", "quantity", "found"), FOUND, ids=[f"{n}-{q}" for n, q, _ in FOUND])
def test_each_number_has_unit_method_and_source(name, quantity, found):
    assert found.unit == QUANTITIES[quantity][1]
    assert found.method
    assert found.source
    assert not found.doi or re.fullmatch(r"10\.\d{4,}/\S+", found.doi)
    assert found.value is not None or (found.low is not None and found.high is not None)
    assert found.value is None or found.value > 0
    assert found.spread is None or found.value is None or 0 < found.spread < found.value
    assert found.low is None or found.low < found.high
    assert found.value is None or found.low is None or found.low <= found.value <= found.high


def test_the_numbers_are_those_of_soft_tissue():
    for name, quantity, found in FOUND:
        low, high = {"density": (300, 1200), "poisson": (0, 0.5), "relaxed": (0, 1)}.get(quantity, (0, 1e5))
        assert found.value is None or low < found.value < high, (name, quantity)


def test_a_young_modulus_from_shear_is_three_times_what_is_printed():
    """E = 2 (1 + nu) mu with nu = 0.5."""
    printed = {
        n: float(re.search(r"shear modulus ([\d.]+)", m.printed)[1]) for n, _, m in FOUND if "shear" in m.printed
    }
    assert set(printed) == {"muscle", "liver", "kidney", "spleen", "liver-carcinoma"}
    for name, shear in printed.items():
        assert TISSUES[name].required("young") == pytest.approx(2 * (1 + 0.5) * shear, rel=1e-9)


def test_breast_tissues_have_the_ratios_of_the_abstract():
    """Fat as gland, fibroadenoma about twice, high-grade ductal carcinoma up to 13 times: Samani et al. 2007."""
    fat, gland, adenoma, cancer = (
        pp.tissue_properties(n).required("young") for n in ("fat", "gland", "fibroadenoma", "breast carcinoma")
    )
    assert fat / gland == pytest.approx(1, abs=0.05)
    assert adenoma / gland == pytest.approx(2, abs=0.1)
    assert cancer / gland == pytest.approx(13, abs=0.5)


def test_a_verified_number_stays_one_that_was_seen():
    """A change of the table must change this list with it: what nobody looked up is not verified."""
    assert {n for n, _, m in FOUND if not m.verified} == {"fat", "gland", "fibroadenoma", "breast-carcinoma"}
    assert all(q == "young" for _, q, m in FOUND if not m.verified)


def test_an_unknown_quantity_asks_for_the_users_word():
    with pytest.raises(MaterialError, match=r"fracture_energy: unknown for kidney.*give the fracture energy in J/m²"):
        pp.tissue_properties("kidney").required("fracture_energy")
    with pytest.raises(MaterialError, match=r"only a range for muscle, 550 to 8000 J/m².*yourself"):
        pp.tissue_properties("muscle").required("fracture_energy")
    with pytest.raises(DataError, match=r"quantity: 'colour'.*young.*fracture_energy"):
        pp.tissue_properties("kidney").measured("colour")
    assert pp.tissue_properties("kidney").described("poisson") == "unknown"


def test_an_unknown_young_modulus_must_be_given(monkeypatch):
    monkeypatch.setitem(TISSUES, "kidney", pp.TissueProperties("kidney"))
    with pytest.raises(MaterialError, match=r"young: unknown for kidney.*give the Young's modulus in kPa yourself"):
        pp.fit(MESH, tissue="kidney", fixed=BOTTOM)
    assert (per_tet("young", 12.0, "kidney") == 12).all()
    with pytest.raises(MaterialError, match="young: unknown for kidney"):
        per_tet("young", {"lump": 12.0}, "kidney")


@pytest.mark.parametrize("name", ["Liver Carcinoma", "liver_carcinoma", " liver-carcinoma "])
def test_a_name_may_be_spelt_with_spaces(name):
    assert pp.tissue_properties(name) is TISSUES["liver-carcinoma"]


@pytest.mark.parametrize(
    ("name", "meant"),
    [("kidny", "kidney"), ("carcinoma", "breast-carcinoma or liver-carcinoma"), ("", "choose one of")],
)
def test_a_name_that_is_not_there_offers_the_nearest(name, meant):
    with pytest.raises(MaterialError, match=rf"tissue: {name!r} is not in the table.*{meant}.*skin.*bowel"):
        pp.tissue_properties(name)


def test_a_named_tissue_gives_the_constants():
    assert (per_tet("young", None, "lung") == TISSUES["lung"].young.value).all()
    assert (per_tet("poisson", None, "lung") == TISSUES["lung"].poisson.value).all()
    mixed = {"organ": "liver", 2: "lung"}
    np.testing.assert_array_equal(per_tet("young", None, mixed), by_region(5.4, 1.4))
    np.testing.assert_array_equal(per_tet("poisson", None, mixed), by_region(0.45, 0.43))


def test_numbers_that_the_user_gives_win():
    np.testing.assert_array_equal(per_tet("young", 7.0, "kidney"), 7.0)
    np.testing.assert_array_equal(per_tet("young", {"lump": 40.0}, "kidney"), by_region(14.7, 40.0))
    np.testing.assert_array_equal(per_tet("young", {1: 3.0}, {"lump": "breast-carcinoma"}), by_region(3.0, 42.52))
    np.testing.assert_array_equal(per_tet("poisson", {2: 0.3}, "lung"), by_region(0.43, 0.3))
    each = np.linspace(1, 2, len(MESH.tets))
    np.testing.assert_array_equal(per_tet("young", each, "kidney"), each)


def test_a_region_without_number_or_name_is_refused():
    with pytest.raises(MaterialError, match=r"young: region 1 \(organ\) has no value.*kPa.*tissue=\"kidney\""):
        pp.fit(MESH, fixed=BOTTOM)
    with pytest.raises(MaterialError, match=r"young: region 1 \(organ\) has no value"):
        per_tet("young", None, {"lump": "kidney"})
    for given in ({"cyst": "kidney"}, {9: "kidney"}):
        with pytest.raises(
            MaterialError, match=r"tissue: the mesh has no region ('cyst'|9); its regions are 1 \(organ\)"
        ):
            named_materials(MESH, given)
    with pytest.raises(MaterialError, match="fixed: no node is held"):
        pp.fit(MESH, tissue="kidney")


@pytest.fixture(scope="module")
def fitted():
    return pp.fit(MESH, {"lump": 20.0}, fixed=BOTTOM, tissue={"organ": "liver", "lump": "lung"})


def test_the_file_keeps_the_names(fitted, tmp_path):
    assert fitted.materials == {1: "liver", 2: "lung"}
    pp.write_tissue(tmp_path / "tissue.vtu", fitted)
    again = pp.read_tissue(tmp_path / "tissue.vtu")
    assert again.materials == fitted.materials
    np.testing.assert_array_equal(again.young, by_region(5.4, 20.0))
    assert pp.Tissue(MESH, 5, 0.4, BOTTOM).materials == {}


def test_the_lines_say_which_numbers_are_from_the_table(fitted):
    liver, lung = material_lines(fitted)
    assert liver.startswith("region 1 (organ): liver; Young's modulus 5.4 ± 1.2 kPa (compiled")
    assert liver.endswith("Poisson's ratio 0.45, not from the table")
    assert lung.startswith("region 2 (lump): lung; Young's modulus 20, not from the table; Poisson's ratio 0.43 (")


def command(*words):
    return CliRunner().invoke(app, ["fit", *map(str, words)], catch_exceptions=True)


def test_the_command_takes_names(tmp_path):
    pp.write_mesh(tmp_path / "mesh.vtu", MESH)
    out = tmp_path / "tissue.vtu"
    done = command(tmp_path / "mesh.vtu", "--tissue", "fat", "--region-tissue", "lump=breast-carcinoma", "-o", out)
    assert done.exit_code == 0, done.output
    tissue = pp.read_tissue(out)
    np.testing.assert_array_equal(tissue.young, by_region(3.25, 42.52))
    np.testing.assert_array_equal(tissue.poisson, 0.45)
    assert tissue.materials == {1: "fat", 2: "breast-carcinoma"}
    for line in material_lines(tissue):
        assert line in done.output
    assert "not verified" in done.output


@pytest.mark.parametrize(
    ("words", "young", "poisson"),
    [
        (["--tissue", "lung", "--young", 8], (8, 8), (0.43, 0.43)),
        (["--tissue", "lung", "--poisson", 0.3], (1.4, 1.4), (0.3, 0.3)),
        (["--tissue", "kidney", "--region-young", "lump=40"], (14.7, 40), (0.45, 0.45)),
        (["--young", 3, "--region-tissue", "lump=lung"], (3, 1.4), (0.45, 0.43)),
        (["--young", 3, "--region-tissue", "2=lung", "--region-young", "lump=9"], (3, 9), (0.45, 0.43)),
    ],
)
def test_the_users_word_wins_in_the_command(tmp_path, monkeypatch, words, young, poisson):
    asked = {}

    def fit(mesh, E, nu, fixed, *, tissue, **more):
        materials = named_materials(mesh, tissue)
        asked["young"] = constant_per_tet("young", young_of(mesh, E, materials), mesh)
        asked["poisson"] = constant_per_tet("poisson", poisson_of(mesh, nu, materials), mesh)
        raise MaterialError("enough")

    monkeypatch.setattr(pp, "fit", fit, raising=False)
    pp.write_mesh(tmp_path / "mesh.vtu", MESH)
    assert "enough" in str(command(tmp_path / "mesh.vtu", *words, "-o", tmp_path / "t.vtu").exception)
    np.testing.assert_array_equal(asked["young"], by_region(*young))
    np.testing.assert_array_equal(asked["poisson"], by_region(*poisson))


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ([], ["--young: region 1 (organ) has no value", "--tissue kidney"]),
        (["--tissue", "kidny"], ["--tissue: 'kidny'", "did you mean kidney?"]),
        (["--young", 3, "--region-tissue", "cyst=fat"], ["--region-tissue", "cyst=fat", "1 (organ), 2 (lump)"]),
        (["--young", 3, "--region-tissue", "lump=stone"], ["--tissue: 'stone'"]),
    ],
)
def test_the_command_refuses_names_that_are_not_there(tmp_path, words, parts):
    pp.write_mesh(tmp_path / "mesh.vtu", MESH)
    refused = command(tmp_path / "mesh.vtu", *words, "-o", tmp_path / "tissue.vtu")
    assert refused.exit_code != 0
    for part in parts:
        assert part in refused.output + str(refused.exception)
    assert [p.name for p in tmp_path.iterdir()] == ["mesh.vtu"]


def test_the_command_lists_the_table():
    said = command("--list-tissues")
    assert said.exit_code == 0
    assert said.output.strip() == tissue_list()
    rows = {line.split()[0]: line for line in said.output.splitlines() if line}
    assert set(TISSUES) < set(rows)
    assert "3.25 ± 0.91*" in rows["fat"]
    assert rows["kidney"].count("unknown") == 6


def test_the_page_is_that_of_the_table():
    """`python docs/tissues.py` writes it."""
    spec = importlib.util.spec_from_file_location("tissues_page", DOCS / "tissues.py")
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    assert (DOCS / "tissues.md").read_text(encoding="utf-8") == made.page()
    for name, _, found in FOUND:
        assert f"### {name}\n" in made.page()
        assert found.text in made.page()
