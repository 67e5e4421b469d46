"""The geometry file: what the templates say, in any unit, and what is wrong is named by its key."""

import numpy as np
import pytest

import palpate as pp
from palpate.errors import FileError, GeometryError
from palpate.scans.geometry_template import VIEWS, template

PANEL = pp.Panel((512, 512), (0.4, 0.4), (-255.5 * 0.4, -255.5 * 0.4, 0))


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def same(a, b):
    return (
        a.shape == b.shape
        and np.allclose(a.source, b.source)
        and all(
            np.allclose(getattr(p, n), getattr(q, n))
            for p, q in zip(a.panels, b.panels, strict=True)
            for n in ("pitch", "origin", "row_axis", "column_axis")
        )
    )


def test_each_template_says_what_its_constructor_does(tmp_path):
    moved = pp.Panel(PANEL.shape, PANEL.pitch, PANEL.origin - [12, 0, 0])
    arm = pp.Panel((512, 512), (0.8, 0.8), (-204.4, 204.4, -500), (0, -1, 0))
    meant = {
        "circular": pp.circular_views(PANEL, count=8, radius=250, height=1000),
        "linear": pp.linear_views(PANEL, count=15, length=500, height=1000),
        "hypocycloid": pp.hypocycloid_views(PANEL, count=24, radius=250, height=1000),
        "arc": pp.arc_views(PANEL, np.linspace(-25, 25, 15), radius=650, pivot=(0, 0, 40)),
        "rotating": pp.rotating_views(arm, np.arange(-20, 21, 4), source=(0, 0, 1000)),
        "orbit": pp.orbit_views((512, 512), (0.8, 0.8), source_to_centre=600, source_to_panel=1000, count=200),
        "parallel": pp.parallel_views((512, 512), (0.8, 0.8), centre_to_panel=400, count=180),
        "free": pp.Views([(-200, 0, 1000), (0, 0, 1000), (200, 0, 1000)], [PANEL, PANEL, moved]),
    }
    assert set(meant) == set(VIEWS)
    for motion, views in meant.items():
        g = pp.read_geometry(written(tmp_path / "g.yaml", template(motion)))
        assert same(g.views, views), motion
        assert (g.values, g.incident, g.background, g.unmeasured) == ("photons", 20000, 0, None)


@pytest.mark.parametrize("motion", VIEWS)
def test_commented_lines_of_a_template_work_when_uncommented(tmp_path, motion):
    lines = []
    for line in template(motion).splitlines():
        bare = line.lstrip().removeprefix("# ")
        key = bare.split(":")[0]
        optional = line.lstrip().startswith("# ") and key.isidentifier() and ": " in bare and "#" in bare
        optional = optional or (line.startswith("  # ") and key.isidentifier())
        lines.append(line.replace("# ", "", 1) if optional else line)
    text = "\n".join(lines)
    g = pp.read_geometry(written(tmp_path / "g.yaml", text))
    assert g.unmeasured == 0
    assert g.dead == tmp_path / "dead.txt"
    assert g.stack.shape == g.views.shape
    assert (g.stack.dtype, g.stack.variable, g.stack.format) == ("uint16", "projections", "raw")
    assert (g.scatter, g.beam.kv, g.beam.target, g.beam.gap) == ("none", 30, "W/Rh", 15)


@pytest.mark.parametrize(("unit", "mm"), [("cm", 10), ("m", 1000), ("um", 0.001)])
@pytest.mark.parametrize("motion", VIEWS)
def test_every_length_follows_the_units_and_no_angle_does(tmp_path, motion, unit, mm):
    text = template(motion).replace("units: mm", f"units: {unit}")
    small = {"cm": 0.1, "m": 0.001, "um": 1000.0}[unit]  # the same object, written in that unit
    import yaml

    content = yaml.safe_load(text)
    lengths = {"pitch", "centre", "origin", "radius", "height", "length", "source", "pivot", "fulcrum"}
    lengths |= {"source_to_centre", "source_to_panel", "centre_to_panel"}

    def rewrite(node):
        if isinstance(node, dict):
            return {k: (np.multiply(v, small).tolist() if k in lengths else rewrite(v)) for k, v in node.items()}
        return [rewrite(v) for v in node] if isinstance(node, list) else node

    assert mm * small == pytest.approx(1)
    there = pp.read_geometry(written(tmp_path / "a.yaml", yaml.safe_dump(rewrite(content)))).views
    assert same(there, pp.read_geometry(written(tmp_path / "b.yaml", template(motion))).views)


def test_blur_is_in_the_units_of_the_file(tmp_path):
    """And stays with the scan that is imported, and with the file that is written anew."""
    text = template("arc").replace("units: mm", "units: cm").replace("radius: 650", "radius: 65")
    path = written(tmp_path / "g.yaml", text + "blur: {panel: 0.02, focal_spot: 0.03, at: 4}\n")
    meant = pp.Blur(panel=0.2, focal_spot=0.3, at=(0, 0, 40))
    assert pp.read_geometry(path).blur == meant
    views = pp.read_geometry(path).views
    pp.write_geometry(tmp_path / "mm.yaml", views, like=path)
    assert pp.read_geometry(tmp_path / "mm.yaml").blur == meant
    assert pp.read_geometry(written(path, text + "blur: {panel: 0.02, at: [1, 2, 3]}\n")).blur == pp.Blur(
        0.2, at=(10, 20, 30)
    )
    np.save(tmp_path / "s.npy", np.full(views.shape, 900.0, np.float32))
    assert pp.import_scan(tmp_path / "s.npy", path).blur == pp.Blur(0.2, at=(10, 20, 30))
    assert pp.read_geometry(written(path, text)).blur is None


def test_a_parallel_beam_of_one_view_is_given_by_its_direction(tmp_path):
    text = template("free").replace("source: [0, 0, 1000]", "direction: [0, 0, -2]")
    views = pp.read_geometry(written(tmp_path / "g.yaml", text)).views
    assert views.parallel.tolist() == [False, True, False]
    low, high = views.project([(3, 4, 10)])[1], views.project([(3, 4, 90)])[1]
    np.testing.assert_allclose(low, high, atol=1e-3)
    for wrong in ("direction: [0, 0, 0]", "source: [0, 0, 9], direction: [0, 0, -1]"):
        bad = template("free").replace("- source: [0, 0, 1000]", "- {" + wrong + "}  ")
        with pytest.raises(GeometryError, match=r"views\[1\].*direction"):
            pp.read_geometry(written(tmp_path / "g.yaml", bad))


def test_angles_as_a_list_or_as_a_run_are_the_same(tmp_path):
    run = "{first: -25, last: 25, count: 15}"
    a = pp.read_geometry(written(tmp_path / "a.yaml", template("arc")))
    b = pp.read_geometry(
        written(tmp_path / "b.yaml", template("arc").replace(run, str(np.linspace(-25, 25, 15).tolist())))
    )
    assert same(a.views, b.views)


def test_one_number_a_view_and_yamls_odd_floats(tmp_path):
    text = template("free").replace("incident: 20000", "incident: [1e5, 2.5, 3]")
    assert np.array_equal(pp.read_geometry(written(tmp_path / "g.yaml", text)).incident, [1e5, 2.5, 3])


ARC, FREE = template("arc"), template("free")
REFUSED = {
    "unknown key": (ARC.replace("radius:", "radios:"), ["'radios'", "views", "did you mean 'radius'"]),
    "unknown top key": (ARC.replace("incident:", "insident:"), ["'insident'", "did you mean 'incident'"]),
    "far from any key": (ARC + "zzz: 1\n", ["'zzz'", "known keys", "panel"]),
    "missing key": (ARC.replace("  radius: 650", "  #"), ["'radius' is missing in views", "template"]),
    "missing panel": ("incident: 1\nviews: []\n", ["'panel' is missing in the file"]),
    "no mapping": ("- 1\n- 2\n", ["the file", "key: value", "template"]),
    "empty": ("", ["the file", "key: value", "None"]),
    "units": (ARC.replace("units: mm", "units: inch"), ["units", "mm, cm, m, um", "'inch'"]),
    "motion": (ARC.replace("motion: arc", "motion: ark"), ["views.motion", "'ark'", "did you mean 'arc'"]),
    "no number": (ARC.replace("radius: 650", "radius: far"), ["views.radius", "number", "'far'"]),
    "bool": (ARC.replace("radius: 650", "radius: yes"), ["views.radius", "number", "True"]),
    "wrong length": (ARC.replace("pitch: [0.4, 0.4]", "pitch: [0.4]"), ["panel.pitch", "2 numbers", "[0.4]"]),
    "60 m": (ARC.replace("radius: 650", "radius: 60_000"), ["54.4185 m away", "check the units"]),
    "microns as mm": (ARC.replace("[0.4, 0.4]", "[400, 400]"), ["204800", "check the units"]),
    "negative radius": (ARC.replace("radius: 650", "radius: -650"), ["radius", "positive", "-650"]),
    "two places": (ARC.replace("  centre:", "  origin: [0, 0, 0]\n  centre:"), ["panel", "either origin", "centre"]),
    "no place": (ARC.replace("  centre:", "  #"), ["panel", "either origin", "neither"]),
    "axes": (ARC.replace("row_axis: [0, 1, 0]", "row_axis: [1, 1, 0]"), ["row_axis", "not orthogonal"]),
    "incident text": (ARC.replace("incident: 20000", "incident: bright"), ["incident", "15", "estimate", "'bright'"]),
    "incident count": (ARC.replace("incident: 20000", "incident: [1, 2]"), ["incident", "15 numbers", "[1, 2]"]),
    "values": (ARC.replace("values: photons", "values: photon"), ["values", "did you mean 'photons'"]),
    "stack axes": (ARC.replace("[view, row, column]", "[view, row, row]"), ["stack.axes", "view, row and column"]),
    "stack dtype": (ARC.replace("stack:", "stack:\n  dtype: uint17"), ["stack.dtype", "uint16", "'uint17'"]),
    "stack key": (ARC.replace("stack:", "stack:\n  ofset: 4"), ["'ofset'", "stack", "did you mean 'offset'"]),
    "count": (ARC.replace("count: 15", "count: 1"), ["views.angles.count", "at least 2", "1"]),
    "free without source": (FREE.replace("- source: [0", "- sauce: [0"), ["'sauce'", "views[1]", "'source'"]),
    "free panel key": (FREE.replace("      centre:", "      pitch: [1, 1]\n      centre:"), ["'pitch'", "views[2]"]),
    "beam": (ARC + "beam: {kv: 30, anode: W}\n", ["'anode'", "beam", "known keys"]),
    "blur": (ARC + "blur: {width: 0.2}\n", ["'width'", "blur", "known keys"]),
    "blur width": (ARC + "blur: {panel: wide}\n", ["blur.panel", "number", "'wide'"]),
    "blur units": (ARC + "blur: {panel: 400}\n", ["blur: panel", "400 mm", "wider than the panel"]),
    "beam voltage": (ARC + "beam: {kv: high}\n", ["beam.kv", "number", "'high'"]),
    "no views": (FREE.split("views:")[0] + "views: []\n", ["views", "empty"]),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_key_value_and_remedy(tmp_path, case):
    text, words = REFUSED[case]
    assert text != ARC
    with pytest.raises(GeometryError) as refusal:
        pp.read_geometry(written(tmp_path / "g.yaml", text))
    for word in ["g.yaml", *words]:
        assert word in str(refusal.value)


def test_what_is_no_yaml_is_named_with_its_line(tmp_path):
    with pytest.raises(FileError, match=r"g\.yaml: not a YAML text .*line 2.*palpate scan template"):
        pp.read_geometry(written(tmp_path / "g.yaml", "units: mm\npanel: [1, 2\nviews: 3\n"))
    with pytest.raises(FileError, match=r"none\.yaml: no such file"):
        pp.read_geometry(tmp_path / "none.yaml")


def test_an_unknown_motion_has_no_template():
    with pytest.raises(GeometryError, match=r"expected one of circular, .* got 'spiral'"):
        template("spiral")
