"""Stacks from elsewhere, and the two samples held against their own description and against themselves."""

import json

import numpy as np
import pytest
import scipy.io
import tifffile
from scipy import ndimage, stats

import palpate as pp
from palpate.errors import DataError, FileError
from palpate.samples import sample
from palpate.scans.geometry_template import template

COUNTS = np.arange(3 * 4 * 5, dtype=np.uint16).reshape(3, 4, 5) + 1000
GEOMETRY = """
incident: 20000
panel: {shape: [4, 5], pitch: [1, 1], centre: [0, 0, 0]}
views: {motion: arc, angles: [-10, 0, 10], radius: 600}
"""


def geometry(folder, extra="", base=GEOMETRY):
    (folder / "g.yaml").write_text(base + extra)
    return folder / "g.yaml"


# --- formats ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dtype", "order"), [("uint16", "little"), ("uint16", "big"), ("float32", "big")])
def test_a_raw_stack_with_header_and_byte_order(tmp_path, dtype, order):
    content = COUNTS.astype(np.dtype(dtype).newbyteorder("<" if order == "little" else ">")).tobytes()
    (tmp_path / "s.raw").write_bytes(b"head" + content)
    g = geometry(tmp_path, f"stack: {{dtype: {dtype}, shape: [3, 4, 5], offset: 4, order: {order}}}\n")
    assert np.array_equal(pp.import_scan(tmp_path / "s.raw", g).counts, COUNTS)


def test_scatter_of_the_geometry_file_joins_the_background(tmp_path):
    np.save(tmp_path / "s.npy", COUNTS)
    np.save(tmp_path / "more.npy", np.full(COUNTS.shape, 7.0))
    plain = pp.import_scan(tmp_path / "s.npy", geometry(tmp_path, "background: 3\n"))
    read = pp.import_scan(tmp_path / "s.npy", geometry(tmp_path, "background: 3\nscatter: more.npy\n"))
    np.testing.assert_allclose(read.background, plain.background + 7)
    g = geometry(
        tmp_path, "background: 3\nscatter: estimate\nbeam: {kv: 31, target: W/Ag, gap: 2, thickness: 4}\nunits: cm\n"
    )
    found = pp.import_scan(tmp_path / "s.npy", g)
    assert (found.notes["kV"], found.notes["beam"], found.notes["air gap"], found.notes["thickness"]) == (
        "31",
        "W/Ag",
        "20 mm",
        "40 mm",
    )
    expected = pp.estimate_scatter(
        pp.Scan(COUNTS, 20000, found.views, 3), pp.scatter_kernels(31, "W/Ag"), 20, thickness=40
    )
    np.testing.assert_allclose(found.background, expected, rtol=1e-6)
    assert (found.background > 3).all()
    with pytest.raises(DataError, match="voltage"):
        pp.import_scan(tmp_path / "s.npy", geometry(tmp_path, "scatter: estimate\n"))


def test_raw_files_one_a_view_follow_in_the_order_of_their_numbers(tmp_path):
    for k, name in enumerate(("v2", "v10", "v11")):
        (tmp_path / f"{name}.bin").write_bytes(COUNTS[k].tobytes())
    g = geometry(tmp_path, "stack: {dtype: uint16, shape: [3, 4, 5]}\n")
    assert np.array_equal(pp.import_scan(tmp_path / "v*.bin", g).counts, COUNTS)


def test_tiff_as_pages_as_files_or_as_a_folder(tmp_path):
    (tmp_path / "views").mkdir()
    tifffile.imwrite(tmp_path / "s.tif", COUNTS, photometric="minisblack")
    for k in range(3):
        tifffile.imwrite(tmp_path / "views" / f"v{9 + k}.tiff", COUNTS[k], compression="zlib")
    g = geometry(tmp_path)
    for stack in (tmp_path / "s.tif", tmp_path / "views", tmp_path / "views" / "v*.tiff"):
        assert np.array_equal(pp.import_scan(stack, g).counts, COUNTS)


@pytest.mark.parametrize("axes", [("view", "row", "column"), ("column", "row", "view"), ("row", "view", "column")])
def test_any_order_of_axes_in_matlab_and_numpy_files(tmp_path, axes):
    stored = COUNTS.transpose([("view", "row", "column").index(a) for a in axes])
    scipy.io.savemat(tmp_path / "s.mat", {"p": stored, "I0": 5.0})
    np.save(tmp_path / "s.npy", stored)
    g = geometry(tmp_path, f"stack: {{axes: [{', '.join(axes)}]}}\n")
    for name in ("s.mat", "s.npy"):
        assert np.array_equal(pp.import_scan(tmp_path / name, g).counts, COUNTS)


@pytest.mark.parametrize("axes", [("view", "row", "column"), ("column", "row", "view"), ("row", "view", "column")])
def test_several_files_of_any_order_of_axes_follow_along_the_views(tmp_path, axes):
    stored = COUNTS.transpose([("view", "row", "column").index(a) for a in axes])
    for k in range(3):
        image = stored.take(k, axis=axes.index("view"))
        np.save(tmp_path / f"v{k}.npy", image)
        (tmp_path / f"v{k}.raw").write_bytes(image.tobytes())
    shape = [("view", "row", "column").index(a) for a in axes]
    shape = [COUNTS.shape[i] for i in shape]
    g = geometry(tmp_path, f"stack: {{axes: [{', '.join(axes)}], dtype: uint16, shape: {shape}}}\n")
    for pattern in ("v*.npy", "v*.raw"):
        assert np.array_equal(pp.import_scan(tmp_path / pattern, g).counts, COUNTS)


def test_unmeasured_and_dead_pixels_are_masked(tmp_path):
    values = COUNTS.astype(np.float32)
    values[0, 1, 2], values[2, 3, 4] = np.nan, np.nan
    np.save(tmp_path / "s.npy", values)
    (tmp_path / "dead.txt").write_text("# row column\n3 0\n\n0 1  # noisy\n")
    g = geometry(tmp_path, "unmeasured: .nan\ndead: dead.txt\nbackground: [1, 2, 3]\n")
    scan = pp.import_scan(tmp_path / "s.npy", g)
    unmeasured = np.argwhere(~scan.mask).tolist()
    dead = [[k, r, c] for k in range(3) for r, c in ((3, 0), (0, 1))]
    assert sorted(unmeasured) == sorted([[0, 1, 2], [2, 3, 4], *dead])
    assert scan.background[:, 0, 0].tolist() == [1, 2, 3]
    assert np.array_equal(scan.counts[scan.mask], COUNTS[scan.mask])


# --- open beam -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("incident", [300, 2_000, 50_000])
def test_the_open_beam_is_found_within_a_percent(incident):
    panel = pp.Panel((96, 128), (1.2, 1.2), (-76, -57, 0))
    views = pp.circular_views(panel, radius=200, height=1000, count=3)
    scan = pp.simulate_scan(pp.slab_phantom(), views, [incident, 1.1 * incident, 0.9 * incident], seed=3)
    counts = scan.counts.copy()
    counts[:, 5:8, 5:20] = 3 * incident  # a burnt-in marker, 0.4 % of the pixels
    levels = pp.open_beam(counts)
    assert np.allclose(levels, np.array([1, 1.1, 0.9]) * incident, rtol=0.01)


def test_the_open_beam_of_the_breast_sample_agrees_with_its_authors():
    scan = pp.import_scan("breast")
    assert np.allclose(pp.open_beam(scan.counts), 42857.142857, rtol=1e-3)


def test_an_open_beam_that_cannot_be_seen_is_refused():
    mask = np.zeros((2, 20, 20), bool)
    mask[0] = True
    with pytest.raises(DataError, match=r"incident of view 1: only 0 measured pixels.*give incident as a number"):
        pp.open_beam(np.full((2, 20, 20), 9.0), mask)


# --- samples ---------------------------------------------------------------------------------------------------------


def test_the_breast_sample_is_where_its_description_says():
    said = json.loads((sample("breast") / "geometry.json").read_text())
    raw = scipy.io.loadmat(sample("breast") / "proj_noi.mat")
    scan = pp.import_scan("breast")
    assert scan.shape == (7, 170, 615)
    assert np.allclose(scan.incident, raw["I0"].item())
    assert scan.mask.all()
    theta = np.radians(said["angles_deg"])
    R = said["source_to_rotation_centre"] * 10
    assert np.allclose(scan.views.source, np.stack([-R * np.sin(theta), 0 * theta, R * np.cos(theta)], axis=1))
    for i, j, view in [(0, 0, 0), (307, 0, 3), (614, 169, 6), (100, 30, 2)]:
        assert scan.counts[view, j, i] == raw["proj_noi"][i, j, view]
        place = scan.views.panels[view].points([j, i])[0]
        assert np.allclose(place, [(i - 307) * 0.4, (j + 0.5) * 0.4, -45])


def test_the_head_sample_is_where_its_description_says():
    said = json.loads((sample("head") / "geometry.json").read_text())
    scan = pp.import_scan("head")
    assert scan.shape == (11, 512, 512)
    for k, (name, degrees) in enumerate(zip(said["files_in_view_order"], said["angles_deg"], strict=True)):
        image = np.frombuffer((sample("head") / name).read_bytes(), np.uint8).reshape(512, 512)
        for row, column in [(40, 300), (255, 100), (300, 480)]:  # order of pixels kept, whatever is done to contrast
            brighter = image[row, column] > image[row, 200]
            assert (scan.counts[k, row, column] > scan.counts[k, row, 200]) == brighter
        assert stats.spearmanr(scan.counts[k, ::7, ::7].ravel(), image[::7, ::7].ravel()).statistic > 0.999999
        assert np.array_equal(scan.mask[k], image > 0)
        t = np.radians(degrees)
        # theirs (x, y, z) is ours (x, z, -y)
        ours = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        towards = np.array([np.sin(t), np.cos(t), 0])
        u, v = np.array([np.cos(t), -np.sin(t), 0]), np.array([0, 0, 1])
        assert np.allclose(scan.views.source[k], ours @ (1000 * towards))
        for row, column in [(0, 0), (511, 0), (255.5, 255.5), (40, 300)]:
            place = -500 * towards + 0.78125 * ((row - 255.5) * v + (column - 255.5) * u)
            assert np.allclose(scan.views.panels[k].points([row, column])[0], ours @ place)
    assert np.linalg.det(ours) == pytest.approx(1)
    assert np.allclose(scan.views.project([0, 0, 0]), 255.5)
    beam = scan.incident[:, 0, 0]
    assert ((beam > 200) & (beam < 250)).all()


def brightest_blob(attenuated):
    """Row and column of the strongest spot of some 3 pixels, well inside the outline, of one view of -log."""
    spots = ndimage.gaussian_filter(attenuated, 3) - ndimage.gaussian_filter(attenuated, 10)
    inside = ndimage.binary_erosion(attenuated > 0.5, iterations=25, border_value=1)
    inside[:8] = False
    return np.unravel_index(np.where(inside, spots, -np.inf).argmax(), spots.shape)


def meeting_point(views, pixels):
    """The point nearest to all rays, by least squares, and how far from each pixel it lands."""
    total, right = np.zeros((3, 3)), np.zeros(3)
    for source, panel, pixel in zip(views.source, views.panels, pixels, strict=True):
        ray = panel.points(pixel)[0] - source
        across = np.eye(3) - np.outer(ray, ray) / (ray @ ray)
        total, right = total + across, right + across @ source
    point = np.linalg.solve(total, right)
    return point, np.abs(views.project(point)[:, 0] - pixels).max()


def test_the_rays_through_the_breast_lesion_meet_inside_the_breast():
    scan = pp.import_scan("breast")
    pixels = np.array([brightest_blob(-np.log(view)) for view in scan.counts / scan.incident], dtype=float)
    point, miss = meeting_point(scan.views, pixels)
    assert miss < 2
    assert np.ptp(pixels[:, 1]) > 20  # it did move
    assert -45 < point[2] < -45 + 51.2  # the breast is 51.2 mm thick and rests on the panel
    # with the arc run the other way the rays would meet below the panel
    mirrored = pp.Views(scan.views.source * [-1, 1, 1], scan.views.panels[0])
    assert meeting_point(mirrored, pixels)[0][2] < -45


# --- what is refused -------------------------------------------------------------------------------------------------


def raw(path):
    path.write_bytes(COUNTS.tobytes()[:-6])


def mat(path, **arrays):
    scipy.io.savemat(path, arrays)


def cut(path, make, keep):
    make(path)
    path.write_bytes(path.read_bytes()[:keep])


NEGATIVE = COUNTS.astype(np.float32) - 1010
RAW = "stack: {dtype: uint16, shape: [3, 4, 5]}\n"
NOISE = np.random.default_rng(0).integers(0, 60000, (3, 4, 5)).astype(np.uint16)
REFUSED = {
    "missing stack": ("s.tif", lambda p: None, "", FileError, ["no such file", "check the name"]),
    "no pattern match": ("s*.tif", lambda p: None, "", FileError, ["no projections there", "'view_*.tif'"]),
    "raw too short": ("s.raw", raw, RAW, FileError, ["114 bytes, 120 expected", "truncated", "stack.shape"]),
    "raw too long": (
        "s.raw",
        lambda p: p.write_bytes(COUNTS.tobytes() + b"x"),
        RAW,
        FileError,
        ["121 bytes", "offset"],
    ),
    "raw parts": (
        "s1.raw",
        lambda p: [raw(p.with_name(f"s{k}.raw")) for k in (1, 2)],
        RAW,
        DataError,
        ["2 files", "(3, 4, 5)", "check both"],
    ),
    "raw unknown": ("s.raw", raw, "", FileError, ["says nothing", "stack.dtype", "stack.shape"]),
    "format": ("s.png", raw, "", FileError, ["cannot tell the format", "stack.format", "raw, tiff, mat or npy"]),
    "half a TIFF": (
        "s.tif",
        lambda p: cut(p, lambda q: tifffile.imwrite(q, NOISE, photometric="minisblack"), 90),
        "",
        FileError,
        ["TIFF", "again"],
    ),
    "no TIFF": ("s.tif", lambda p: p.write_text("nothing"), "", FileError, ["not a whole TIFF", "again"]),
    "half a MAT": (
        "s.mat",
        lambda p: cut(p, lambda q: mat(q, p=NOISE), 200),
        "",
        FileError,
        ["not a whole MATLAB", "again"],
    ),
    "no MAT": ("s.mat", lambda p: p.write_text("x" * 999), "", FileError, ["not a whole MATLAB", "again"]),
    "half an NPY": ("s.npy", lambda p: cut(p, lambda q: np.save(q, NOISE), 150), "", FileError, ["NumPy", "again"]),
    "two variables": ("s.mat", lambda p: mat(p, p=NOISE, q=NOISE), "", DataError, ["stack.variable", "p (3, 4, 5), q"]),
    "no variable": (
        "s.mat",
        lambda p: mat(p, p=NOISE),
        "stack: {variable: z}\n",
        DataError,
        ["no variable z", "p (3, 4, 5)"],
    ),
    "shape": ("s.npy", lambda p: np.save(p, COUNTS[:2]), "", DataError, ["(2, 4, 5)", "(3, 4, 5)", "panel.shape"]),
    "transposed": ("s.npy", lambda p: np.save(p, COUNTS.T), "", DataError, ["(5, 4, 3)", "axes: [column, row, view]"]),
    "two axes": ("s.npy", lambda p: np.save(p, np.ones(7)), "", DataError, ["(7,)", "three axes"]),
    "dtype": ("s.npy", lambda p: np.save(p, COUNTS * 1j), "", DataError, ["complex128", "export it as numbers"]),
    "text": ("s.npy", lambda p: np.save(p, COUNTS.astype(str)), "", DataError, ["<U", "export it as numbers"]),
    "NaN": ("s.npy", lambda p: np.save(p, COUNTS * np.nan), "", DataError, ["s.npy", "counts", "nan", "mask"]),
    "negative": (
        "s.npy",
        lambda p: np.save(p, NEGATIVE),
        "",
        DataError,
        ["10 measured", "view 0, row 0, column 0: -10"],
    ),
    "zero incident": (
        "s.npy",
        lambda p: np.save(p, COUNTS),
        "incident: 0\n",
        DataError,
        ["incident", "60 measured", "mask"],
    ),
    "background": (
        "s.npy",
        lambda p: np.save(p, COUNTS),
        "background: -3\n",
        DataError,
        ["background", "-3", "below 0"],
    ),
    "all unmeasured": (
        "s.npy",
        lambda p: np.save(p, COUNTS * 0),
        "unmeasured: 0\n",
        DataError,
        ["no pixel is measured"],
    ),
    "no dead list": (
        "s.npy",
        lambda p: np.save(p, COUNTS),
        "dead: none.txt\n",
        FileError,
        ["none.txt", "no such file"],
    ),
    "dead text": (
        "s.npy",
        lambda p: np.save(p, COUNTS),
        "dead: g.yaml\n",
        DataError,
        ["g.yaml, line 2", "'row column'"],
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_name_value_and_remedy(tmp_path, case):
    name, make, extra, kind, words = REFUSED[case]
    make(tmp_path / name)
    base = GEOMETRY.replace("incident: 20000\n", "") if "incident" in extra else GEOMETRY
    g = geometry(tmp_path, extra, base)
    with pytest.raises(kind) as refusal:
        pp.import_scan(tmp_path / ("s*.raw" if case == "raw parts" else name), g)
    for word in words:
        assert word in str(refusal.value)


def test_a_dead_pixel_off_the_panel_is_refused(tmp_path):
    np.save(tmp_path / "s.npy", COUNTS)
    (tmp_path / "dead.txt").write_text("1 1\n4 0\n")
    with pytest.raises(
        DataError, match=r"dead\.txt, line 2: pixel \(4, 0\) is not on a panel of \(4, 5\); count from 0"
    ):
        pp.import_scan(tmp_path / "s.npy", geometry(tmp_path, "dead: dead.txt\n"))


def test_a_stack_without_geometry_is_told_how_to_get_one(tmp_path):
    np.save(tmp_path / "s.npy", COUNTS)
    with pytest.raises(FileError, match=r"s\.npy: no geometry file; .*palpate scan template.*breast, head"):
        pp.import_scan(tmp_path / "s.npy")
    with pytest.raises(FileError, match="bresat: no such file"):
        pp.import_scan("bresat")


def test_every_template_imports_a_stack_that_fits_it(tmp_path):
    for motion, views in (
        ("circular", 8),
        ("linear", 15),
        ("hypocycloid", 24),
        ("arc", 15),
        ("rotating", 11),
        ("free", 3),
    ):
        small = template(motion).replace("[512, 512] ", "[6, 7] ")
        np.save(tmp_path / "s.npy", np.full((views, 6, 7), 100, np.uint16))
        assert pp.import_scan(tmp_path / "s.npy", geometry(tmp_path, base=small)).shape == (views, 6, 7)


# --- contrast --------------------------------------------------------------------------------------------------------


def test_views_raised_to_different_powers_come_back_to_one_scale():
    panel = pp.Panel((60, 80), (2, 2), (-79, -59, 0))
    views = pp.arc_views(panel, [-10, 0, 10], radius=900, pivot=(0, 0, 50))
    passed = pp.simulate_scan(pp.slab_phantom(), views, 1, seed=None).counts
    spoilt = passed ** np.array([0.8, 1, 1.3])[:, None, None]
    p, q, r = (-np.log(v) for v in (passed, spoilt, pp.equal_contrast(spoilt, 1)))
    middle = p > 0.5
    assert np.abs(q[middle] / p[middle] - 1).max() > 0.25
    assert np.abs(r[middle] / p[middle] - 1).max() < 0.02


def test_contrast_needs_something_in_the_beam_and_spares_photons(tmp_path):
    with pytest.raises(DataError, match=r"contrast of view 0: .* 0, nothing is in the beam"):
        pp.equal_contrast(np.ones((2, 4, 5)), 1)
    with pytest.raises(ValueError, match=r"g\.yaml: contrast: equal would spoil .* leave it out"):
        pp.read_geometry(geometry(tmp_path, "contrast: equal\n"))


def test_neighbouring_views_of_the_head_agree_in_contrast():
    """Quantiles of -log are alike in views 4° apart; as stored, two steps jump by more than a quarter."""
    scan = pp.import_scan("head")
    stored = np.stack([np.fromfile(sample("head") / f"1-{k:04d}", np.uint8).reshape(512, 512) for k in range(2, 13)])
    seen = ndimage.binary_erosion(scan.mask.all(axis=0), iterations=20)

    def ratios(values):
        p = np.log(scan.incident / np.maximum(values, 1))
        levels = np.array([np.quantile(view[seen], [0.7, 0.8, 0.9]).mean() for view in p])
        return np.abs(np.diff(np.log(levels)))

    assert ratios(stored).max() > np.log(1.25)
    assert ratios(scan.counts).max() < np.log(1.05)


# --- the sense of rotation -------------------------------------------------------------------------------------------


def bar_slope(image, columns, rows):
    """Rows per column, and the row at the middle, of the strongest dark-to-bright edge that runs across a window."""
    steps = np.diff(ndimage.gaussian_filter(image.astype(float), (1, 3)), axis=0)[slice(*rows), slice(*columns)]
    across, down = np.arange(*columns), rows[0] + 0.5 + steps.argmax(axis=0)
    for _ in range(5):
        slope, row = np.polyfit(across - np.mean(columns), down, 1)
        miss = down - row - slope * (across - np.mean(columns))
        near = np.abs(miss) < max(1, 2 * miss.std())
        across, down = across[near], down[near]
    return np.polyfit(across - np.mean(columns), down, 1)


@pytest.mark.parametrize(("first", "last", "columns"), [(0, 3, (260, 345)), (7, 10, (60, 200))])
def test_the_cross_bar_of_the_couch_turns_with_the_head_views(first, last, columns):
    """A bar across the axis tilts in the image as the near end grows: by how much and which way needs no depth."""
    scan = pp.import_scan("head")

    def predicted(views):
        slopes = []
        for k in (first, last):
            row = bar_slope(scan.counts[k], columns, (36, 60))[1]
            ray = views.panels[k].points([row, np.mean(columns)])[0] - views.source[k]
            point = views.source[k] + 0.8 * ray  # any depth gives the same tilt
            a, b = views.project(np.stack([point, point]) + [[-5, 0, 0], [5, 0, 0]])[k]
            slopes.append((b - a)[0] / (b - a)[1])
        return slopes[1] - slopes[0]

    measured = bar_slope(scan.counts[last], columns, (36, 60))[0] - bar_slope(scan.counts[first], columns, (36, 60))[0]
    assert measured == pytest.approx(predicted(scan.views), rel=0.2)
    mirrored = pp.rotating_views(scan.views[[5]].panels[0], np.arange(20, -21, -4), source=(0, 0, 1000))
    assert measured * predicted(mirrored) < 0
