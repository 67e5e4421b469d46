"""Projections in DICOM: tube and panel where the tags say, and a refusal that names the tag which is missing."""

import numpy as np
import pydicom
import pytest
from support.dicom_files import CT, RADIOGRAPH, breast_projection, changed, ct_slice, item, view
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import DataError, FileError, GeometryError

ANGLES = [-15, 0, 15]
SHAPE = (3, 30, 40)
STANDING = np.diag([-1.0, -1.0, 1.0])  # gantry right, rear, up to patient left, posterior, superior
POINTS = np.array([[3.0, 8, 5], [-4, 5, -12], [0, 2, 30]])  # isocentre's frame


def counts(seed=0):
    """Mostly open beam at 50,000, an object in the middle of each view."""
    rng = np.random.default_rng(seed)
    y = np.full(SHAPE, 50_000.0) + rng.normal(0, 50, SHAPE)
    y[:, 10:20, 15:25] = rng.uniform(5_000, 20_000, (3, 10, 10))
    return np.rint(y).astype(np.uint16)


def landing(source, corner, row_direction, column_direction, point):
    """Row and column where the ray from source through point meets the panel: three linear equations."""
    steps = np.stack([row_direction * 0.5, column_direction * 0.4, source - point], axis=1)
    return np.linalg.solve(steps, source - corner)[:2]


def in_patient(points, views):
    """From the isocentre's frame through the patient's (LPS) to the views' world."""
    return points @ STANDING @ views.direction


def test_frames_lie_where_their_isocentre_system_says(tmp_path):
    y = counts()
    scan = pp.read_scan(breast_projection(tmp_path / "p.dcm", y, ANGLES))
    assert np.array_equal(scan.counts, y)
    assert np.allclose(scan.incident, 50_000, rtol=2e-3)
    assert np.array_equal(scan.views.direction, np.eye(3))  # the panel lies level: the world is the patient's
    for k, angle in enumerate(np.radians(ANGLES)):
        source = 660 * np.array([np.sin(angle), 0, np.cos(angle)])
        corner = np.array([-29 / 2 * 0.5, 0.2, -40])
        for p, pixel in zip(POINTS, scan.views.project(in_patient(POINTS, scan.views))[k], strict=True):
            assert np.allclose(pixel, landing(source, corner, np.eye(3)[0], np.eye(3)[1], p), atol=1e-9)


def test_a_turned_and_moving_panel_is_followed_and_the_patient_with_it(tmp_path):
    """The whole gantry at 45° (MLO): the same rays, in a world whose z is the panel's normal."""
    path = tmp_path / "p.dcm"
    turned = {"DetectorIsocenterPrimaryAngle": 45.0, "DetectorXPositionToIsocenter": -40 * np.sin(np.pi / 4)}
    turned["DetectorZPositionToIsocenter"] = -40 * np.cos(np.pi / 4)
    scan = pp.read_scan(breast_projection(path, counts(), [30, 45, 60], iso=turned))
    c = s = np.sqrt(0.5)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])  # z towards x
    assert np.allclose(scan.views.panels[0].normal * np.sign(scan.views.panels[0].normal[2]), [0, 0, 1])
    assert (scan.views.source[:, 2] > 600).all()
    # The panel's normal in the patient: half up, half to the patient's right, which is gantry right.
    assert np.allclose(scan.views.direction[:, 2], [-s, 0, c])
    for k, angle in enumerate(np.radians([30, 45, 60])):
        source = 660 * np.array([np.sin(angle), 0, np.cos(angle)])
        corner = turn @ np.array([-29 / 2 * 0.5, 0.2, -40])
        for p, pixel in zip(POINTS, scan.views.project(in_patient(POINTS, scan.views))[k], strict=True):
            assert np.allclose(pixel, landing(source, corner, turn[:, 0], turn[:, 1], p), atol=1e-9)
    assert np.allclose(pp.covering_grid(scan.views, 40).direction, scan.views.direction)


def test_without_a_distance_to_the_isocentre_that_to_the_chest_walls_edge_serves(tmp_path):
    """The edge's middle lies 40 mm under the isocentre: at 0° the tube is 700 mm above it."""
    iso = {"DetectorActiveAreaTLHCPosition": [-29 / 2 * 0.5, 0.2, 0.0]}
    path = breast_projection(tmp_path / "p.dcm", counts(), [0, 0, 0], iso, {"DistanceSourceToIsocenter": None})
    assert np.allclose(pp.read_scan(path).views.source, [0, 0, 660])


def test_a_field_that_is_part_of_the_panel_is_shifted_by_whole_elements(tmp_path):
    whole = pp.read_scan(breast_projection(tmp_path / "a.dcm", counts(), ANGLES)).views
    tags = {"DetectorElementSpacing": [0.25, 0.2], "DetectorActiveOrigin": [2, 3], "FieldOfViewOrigin": [12, 8]}
    part = pp.read_scan(breast_projection(tmp_path / "b.dcm", counts(), ANGLES, **tags)).views
    # 10 elements of 0.25 mm are 5 rows, 5 of 0.2 mm are 2.5 columns; a pixel of 2 x 2 elements has its centre between.
    shift = part.project(POINTS) - whole.project(POINTS)
    assert np.allclose(shift, [-5 - 0.25, -2.5 - 0.25])


def write_views(folder, y, angles=ANGLES, sop_class=None, **tags):
    folder.mkdir(exist_ok=True)
    kind = {} if sop_class is None else {"sop_class": sop_class}
    for k, (image, angle) in enumerate(zip(y, angles, strict=True)):
        own = {"PositionerPrimaryAngle": angle, "InstanceNumber": k + 1, **tags}
        view(folder / f"v{9 - k}.dcm", image, **kind, **own)  # names run against the order
    return folder


def test_a_file_a_view_swings_about_its_isocentre(tmp_path):
    """A left cranio-caudal view: rows of pixels run to anterior, columns to the right, the tube to the left is positive."""
    y = counts()
    scan = pp.read_scan(write_views(tmp_path / "v", y))
    assert np.array_equal(scan.counts, y)
    assert np.array_equal(scan.views.direction, np.eye(3))
    corner = np.array([29 / 2 * 0.5, -0.2, 0])  # chest wall at y = 0: LPS, anterior is -y, right is -x
    for k, angle in enumerate(np.radians(ANGLES)):
        source = np.array([660 * np.sin(angle), 0, 40 + 660 * np.cos(angle)])
        assert np.allclose(scan.views.source[k], source)
        for p, pixel in zip(POINTS, scan.views.project(POINTS)[k], strict=True):
            assert np.allclose(pixel, landing(source, corner, np.array([-1.0, 0, 0]), np.array([0, -1.0, 0]), p))
    # clockwise: the same angle is towards the right
    other = pp.read_scan(write_views(tmp_path / "w", y, PositionerPrimaryAngleDirection="CW"))
    assert np.allclose(other.views.source, scan.views.source * [-1, 1, 1])


def test_multi_frame_and_a_file_a_view_are_the_same_scan(tmp_path):
    """Gantry right is the patient's right, so the angles of the two objects have opposite signs."""
    y = counts()
    iso = {"DetectorActiveAreaTLHCPosition": [-29 / 2 * 0.5, 0.2, 0.0]}
    one = pp.read_scan(breast_projection(tmp_path / "p.dcm", y, [15, 0, -15], iso))
    many = pp.read_scan(write_views(tmp_path / "v", y))
    assert np.allclose(one.views.source + [0, 0, 40], many.views.source)
    assert np.allclose(one.views.project(POINTS), many.views.project(POINTS + [0, 0, 40]))


@pytest.mark.parametrize(("orientation", "laterality"), [(["A", "R"], "L"), (["P", "L"], "R"), (["A", "L"], "L")])
def test_however_the_image_is_stored_the_shadow_of_the_left_lies_left(tmp_path, orientation, laterality):
    tags = {"PatientOrientation": orientation, "ImageLaterality": laterality}
    views = pp.read_scan(write_views(tmp_path / "v", counts(), **tags)).views
    left, right, front = (views.project(p)[1, 0] for p in ([5, -4, 10], [-5, -4, 10], [5, -8, 10]))
    assert (left[0] > right[0]) == (orientation[1] == "L")
    assert (front[1] > left[1]) == (orientation[0] == "A")
    # over the chest wall's edge the ray at 0° is vertical
    assert np.allclose(views.project([0, 0, 10])[1, 0, 1], -0.5 if orientation[0] == "A" else 39.5)


def test_detector_angles_tilt_the_beam_against_the_image(tmp_path):
    """A radiograph from the front: towards higher columns and lower rows for positive angles."""
    tags = {"PatientOrientation": ["L", "F"], "ViewPosition": "AP", "sop_class": RADIOGRAPH}
    y = counts()
    write_views(tmp_path / "v", y, DetectorPrimaryAngle=10, DetectorSecondaryAngle=5, **tags)
    views = pp.read_scan(tmp_path / "v").views
    above, on = views.project([[0, 0, 20], [0, 0, 0]])[0]
    assert above[1] - on[1] == pytest.approx(20 * np.tan(np.radians(10)) / 0.4, rel=0.1)
    assert above[0] - on[0] == pytest.approx(-20 * np.tan(np.radians(5)) / 0.5, rel=0.1)
    assert np.allclose(views.direction[:, 2], [0, -1, 0])  # the tube is in front
    assert np.allclose(views.direction[:, 0], [1, 0, 0])


def test_padding_is_no_measurement(tmp_path):
    y = counts()
    y[:, :3] = 7
    path = breast_projection(tmp_path / "p.dcm", y, ANGLES, PixelPaddingValue=7)
    mask = pp.read_scan(path).mask
    assert not mask[:, :3].any()
    assert mask[:, 3:].all()


def test_a_geometry_file_beside_replaces_the_tags(tmp_path):
    y = counts()
    folder = write_views(tmp_path / "v", y, DistanceSourceToIsocenter=None)
    text = (
        "values: intensity\nincident: 50000\npanel: {shape: [30, 40], pitch: [0.5, 0.4], centre: [0, 0, 0]}\n"
        "views: {motion: arc, angles: [-15, 0, 15], radius: 600}\n"
    )
    (tmp_path / "g.yaml").write_text(text)
    given = pp.import_scan(folder, tmp_path / "g.yaml")
    (folder / "geometry.yaml").write_text(text)
    for scan in (given, pp.read_scan(folder), pp.read_scan(folder / "v9.dcm")):
        assert np.array_equal(scan.counts, y)
        assert np.allclose(scan.views.source, pp.arc_views(scan.views.panels[0], ANGLES, radius=600).source)


def test_the_command_says_what_is_assumed_and_the_scan_file_keeps_the_patients_directions(tmp_path):
    path = breast_projection(tmp_path / "p.dcm", counts(), [40, 45, 50], {"DetectorIsocenterPrimaryAngle": 45.0})
    told = CliRunner().invoke(app, ["scan", "import", str(path), "-o", str(tmp_path / "s.h5")])
    assert told.exit_code == 0, told.output
    assert "no photon counts" in told.output
    assert "least-squares" in told.output
    back, scan = pp.read_scan(tmp_path / "s.h5"), pp.read_scan(path)
    assert np.array_equal(back.counts, scan.counts)
    assert np.array_equal(back.views.direction, scan.views.direction)
    assert np.array_equal(back.views.project(POINTS), scan.views.project(POINTS))


MULTI = {
    "XRaySourceIsocenterPrimaryAngle": r"frame 1: lacks X-Ray Source Isocenter Primary Angle \(0018,9543\)",
    "DetectorIsocenterPrimaryAngle": r"Detector Isocenter Primary Angle \(0018,9550\)",
    "DetectorZPositionToIsocenter": r"Detector Z Position to Isocenter \(0018,9554\)",
    "DetectorActiveAreaTLHCPosition": r"Detector Active Area TLHC Position \(0018,9557\)",
    "DetectorActiveAreaOrientation": r"Detector Active Area Orientation \(0018,9558\)",
}


@pytest.mark.parametrize("keyword", MULTI)
def test_a_frame_without_a_tag_is_named_with_it(tmp_path, keyword):
    path = breast_projection(tmp_path / "p.dcm", counts(), ANGLES, {keyword: None})
    with pytest.raises(FileError, match=rf"p\.dcm, .*{MULTI[keyword]}.*--geometry"):
        pp.read_scan(path)


SINGLE = {
    "ImagerPixelSpacing": r"Imager Pixel Spacing \(0018,1164\)",
    "DistanceSourceToDetector": r"Distance Source to Detector \(0018,1110\)",
    "DistanceSourceToIsocenter": r"Distance Source to Isocenter \(0018,9402\)",
    "PositionerPrimaryAngle": r"Positioner Primary Angle \(0018,1510\)",
    "PatientOrientation": r"Patient Orientation \(0020,0020\)",
    "ViewPosition": r"View Position \(0018,5101\)",
    "PixelIntensityRelationship": r"Pixel Intensity Relationship \(0028,1040\)",
}


@pytest.mark.parametrize("keyword", SINGLE)
def test_a_view_without_a_tag_is_named_with_it(tmp_path, keyword):
    folder = write_views(tmp_path / "v", counts())
    changed(folder / "v7.dcm", **{keyword: None})
    with pytest.raises(FileError, match=rf"v7\.dcm: .*{SINGLE[keyword]}.*geometry"):
        pp.read_scan(folder)


REFUSED = {
    "shown": ({"SOPClassUID": "1.2.840.10008.5.1.4.1.1.1.2"}, DataError, "for the eye.*For Processing"),
    "CT": ({"SOPClassUID": CT}, DataError, r"\(0008,0016\) is CT Image Storage.*no projections"),
    "log": ({"PixelIntensityRelationship": "LOG"}, DataError, r"\(0028,1040\) is LOG.*export linear"),
    "sign": ({"PixelIntensityRelationshipSign": -1}, DataError, r"\(0028,1041\).*lower numbers"),
    "NaN": ({"DistanceSourceToDetector": "nan"}, FileError, r"\(0018,1110\) is .*expected 1 finite"),
    "orientation": ({"PatientOrientation": ["X", "R"]}, FileError, r"\(0020,0020\) is \['X', 'R'\]"),
    "parallel": ({"PatientOrientation": ["A", "P"]}, FileError, "no two directions at right angles"),
    "view": ({"ViewPosition": "AP"}, FileError, r"does not go with View Position"),
    "colour": ({"SamplesPerPixel": 3}, DataError, "3 numbers a pixel"),
    "bits": ({"HighBit": 17}, FileError, "cannot be"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_name_value_and_remedy(tmp_path, case):
    tags, kind, words = REFUSED[case]
    folder = write_views(tmp_path / "v", counts())
    changed(folder / "v8.dcm", **tags)
    with pytest.raises(kind, match=rf"v8\.dcm.*{words}"):
        pp.read_scan(folder)


def test_views_that_do_not_fit_together_are_refused(tmp_path):
    y = counts()
    folder = write_views(tmp_path / "v", y)
    changed(folder / "v8.dcm", DistanceSourceToDetector=750)
    with pytest.raises(GeometryError, match=r"\(0018,1110\).*make it"):
        pp.read_scan(folder)
    folder = write_views(tmp_path / "w", y)
    changed(folder / "v8.dcm", SeriesInstanceUID="1.2.99")
    with pytest.raises(FileError, match=r"holds 2 series; .*v7\.dcm \(2 files\), v8\.dcm \(1 files\)"):
        pp.read_scan(folder)
    assert len(pp.read_scan(folder / "v7.dcm").views) == 2
    folder = write_views(tmp_path / "x", y)
    view(folder / "v8.dcm", y[0, 1:], InstanceNumber=2)
    with pytest.raises(DataError, match=r"v8\.dcm: \(29, 40\) pixels, \(30, 40\) in"):
        pp.read_scan(folder)


def test_a_turned_mammograms_positioner_angle_is_not_enough(tmp_path):
    folder = write_views(tmp_path / "v", counts(), PatientOrientation=["A", "FR"], ViewPosition="MLO")
    with pytest.raises(FileError, match=r"lacks Detector Primary Angle \(0018,1530\)"):
        pp.read_scan(folder)


def test_an_overview_of_a_ct_is_no_projection(tmp_path):
    view(tmp_path / "v.dcm", counts()[0], ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"])
    for path in (tmp_path, tmp_path / "v.dcm"):
        with pytest.raises(FileError, match="no projections there, only overviews"):
            pp.read_scan(path)


def test_projections_are_told_from_volumes(tmp_path):
    folder = tmp_path / "slices"
    folder.mkdir()
    slices = ct_slice(folder / "1.dcm", np.zeros((4, 5), np.int16)).parent
    assert pp.is_scan(breast_projection(tmp_path / "p.dcm", counts(), ANGLES))
    assert pp.is_scan("anything.h5")
    assert not pp.is_scan(slices)
    assert not pp.is_scan(tmp_path / "volume.nii.gz")


def test_a_truncated_multi_frame_file_is_named(tmp_path):
    path = breast_projection(tmp_path / "p.dcm", counts(), ANGLES)
    path.write_bytes(path.read_bytes()[:-999])
    with pytest.raises(FileError, match=r"p\.dcm: .*(truncated|damaged|cut short).*again"):
        pp.read_scan(path)


def test_without_open_beam_the_view_is_named(tmp_path):
    path = breast_projection(tmp_path / "p.dcm", np.zeros((1, 4, 5), np.uint16), [0])
    with pytest.raises(DataError, match=r"p\.dcm: incident of view 0: .*give incident as a number"):
        pp.read_scan(path)


# --- scales and turns that tags tell ---------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [1, -1])
def test_a_logarithm_with_its_slope_is_a_dose(tmp_path, sign):
    y = counts()
    plain = pp.read_scan(write_views(tmp_path / "lin", y))
    stored = np.rint(1000 * (np.log(y) if sign == 1 else 12 - np.log(y))).astype(np.uint16)
    tags = {"PixelIntensityRelationship": "LOG", "PixelIntensityRelationshipSign": sign, "RescaleSlope": 0.001}
    folder = write_views(tmp_path / "log", stored, **tags, RescaleIntercept=0.5)
    with pytest.warns(UserWarning, match=r"natural logarithms of the dose, after Rescale Slope \(0028,1053\)"):
        scan = pp.read_scan(folder)
    ours, theirs = pp.line_integrals(scan), pp.line_integrals(plain)
    assert theirs.max() > 0.9
    assert np.abs(ours - theirs).max() < 2e-3  # half a stored step of each, and of the open beam


def test_a_slope_that_turns_the_sign_makes_a_dose(tmp_path):
    """Stored numbers fall with the dose, and the slope is negative: linear, and its end is told."""
    y = counts()
    tags = {"PixelIntensityRelationshipSign": -1, "RescaleSlope": -1, "RescaleIntercept": 65535}
    assert np.array_equal(pp.read_scan(write_views(tmp_path / "v", 65535 - y, **tags)).counts, y)
    with pytest.raises(DataError, match=r"Sign \(0028,1041\) and Rescale Slope \(0028,1053\).*lower numbers"):
        pp.read_scan(write_views(tmp_path / "w", y, RescaleSlope=-1, RescaleIntercept=65535))


def test_a_slope_in_a_functional_group_is_found(tmp_path):
    y = counts()
    path = breast_projection(tmp_path / "p.dcm", y, ANGLES)
    dataset = pydicom.dcmread(path)
    dataset.SharedFunctionalGroupsSequence[0].PixelValueTransformationSequence = [
        item(RescaleSlope=2, RescaleIntercept=-100, RescaleType="US")
    ]
    dataset.save_as(path)
    assert np.array_equal(pp.read_scan(path).counts, 2.0 * y - 100)


@pytest.mark.parametrize(("turn", "flip"), [(180, "NO"), (0, "YES"), (180, "YES")])
def test_a_turned_or_flipped_field_of_view_is_turned_back(tmp_path, turn, flip):
    """The image was turned, then flipped, from what the detector read, to which its place belongs."""
    y = counts()
    stored = y[:, ::-1, ::-1] if turn else y
    stored = stored[:, :, ::-1] if flip == "YES" else stored
    plain = pp.read_scan(breast_projection(tmp_path / "a.dcm", y, ANGLES))
    tags = {"FieldOfViewRotation": turn, "FieldOfViewHorizontalFlip": flip}
    scan = pp.read_scan(breast_projection(tmp_path / "b.dcm", stored, ANGLES, **tags))
    assert np.array_equal(scan.counts, plain.counts)
    assert np.array_equal(scan.views.project(POINTS), plain.views.project(POINTS))


def test_a_quarter_turn_is_refused(tmp_path):
    path = breast_projection(tmp_path / "a.dcm", counts(), ANGLES, FieldOfViewRotation=90)
    with pytest.raises(FileError, match=r"turned by 90 degrees \(Field of View Rotation \(0018,7032\)\)"):
        pp.read_scan(path)
