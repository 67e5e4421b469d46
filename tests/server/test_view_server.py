"""What `palpate view` sends: axes, means, presets; who is let in; the command."""

import signal

import httpx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.running_server import start

import palpate as pp
from palpate.commands import main
from palpate.server.image_payloads import block_means, volume_payload
from palpate.server.loopback_server import loopback_socket
from palpate.server.view import image_payloads, serving_images
from palpate.volumes.display_window import window_presets
from palpate.volumes.patient_axes import reorient_to_patient


def numbered(direction=None, shape=(3, 4, 5), unit="HU"):
    values = np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
    return pp.Volume(values, pp.Grid(shape, (3, 2, 1.5), (5, -7, 11), direction), unit)


@given(st.integers(0, 2**32 - 1))
def test_no_voxel_moves_when_axes_are_put_along_the_patient(seed):
    volume = numbered(Rotation.random(random_state=np.random.default_rng(seed)).as_matrix())
    values, grid = reorient_to_patient(volume)
    every = np.argwhere(np.ones(grid.shape, dtype=bool))
    there = np.rint(volume.grid.indices(grid.points(every))).astype(int)
    np.testing.assert_array_equal(values[tuple(every.T)], volume.values[tuple(there.T)])
    image = volume_payload(volume, "").image
    given_index = np.column_stack([every, np.ones(len(every))]) @ np.array(image.file).reshape(3, 4).T
    np.testing.assert_allclose(given_index, there, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_small_tilts_keep_left_left(seed):
    """A head tilted by up to 30 degrees, stored with its axes in any order and sense."""
    rng = np.random.default_rng(seed)
    tilt = Rotation.from_rotvec(np.radians(30) * rng.uniform(-1, 1, 3) / np.sqrt(3)).as_matrix()
    order = np.eye(3)[rng.permutation(3)] * rng.choice([-1, 1], 3)
    stored = tilt @ (order if np.linalg.det(order) > 0 else -order)
    assert np.diag(reorient_to_patient(numbered(stored))[1].direction).min() > 0.8


def test_a_volume_too_large_for_a_page_is_sent_as_means_and_says_so():
    volume = numbered(shape=(6, 50, 61))
    shown = volume_payload(volume, "big", most=6000)
    (values,) = shown.values
    assert values.size <= 6000
    block = [-(-n // m) for n, m in zip(volume.grid.shape, values.shape, strict=True)]
    assert block[2] > 1
    k, i, j = 1, 3, 2
    part = tuple(slice(b * at, b * (at + 1)) for b, at in zip(block, (k, i, j), strict=True))
    assert values[k, i, j] == pytest.approx(volume.values[part].mean(), rel=1e-5)
    centre = [b * at + (b - 1) / 2 for b, at in zip(block, (k, i, j), strict=True)]
    image = shown.image
    step = np.array([j, i, k]) * image.spacing[::-1]
    np.testing.assert_allclose(np.array(image.origin) + step, volume.grid.points(centre)[0])
    assert "too many for a page" in image.note
    assert " × ".join(map(str, block)) in image.note
    assert volume_payload(volume, "").image.note == ""


@given(st.tuples(*[st.integers(1, 9)] * 3), st.integers(1, 200))
def test_means_of_blocks_keep_the_sum(shape, most):
    values = np.random.default_rng(0).uniform(size=shape).astype(np.float32)
    means, factors = block_means(values, (3, 2, 1), most)
    assert means.size <= most
    counts = [np.diff(np.append(np.arange(0, n, f), n)) for n, f in zip(shape, factors, strict=True)]
    weights = np.einsum("i,j,k->ijk", *counts)
    assert (means * weights).sum() == pytest.approx(values.sum(), rel=1e-4)


def test_values_travel_in_the_smallest_type_that_loses_nothing():
    cases = {(-900, 3000): "int16", (0, 60_000): "uint16", (0.5, 1): "float32", (0, 70_000): "float32"}
    for values, kind in cases.items():
        volume = pp.Volume(np.reshape(values, (1, 1, 2)), pp.Grid((1, 1, 2), (1, 1, 1)), "HU")
        shown = volume_payload(volume, "")
        assert shown.image.stacks[0].kind == shown.values[0].dtype.name == kind
        np.testing.assert_array_equal(shown.values[0].ravel(), np.float32(values))


def test_presets_are_those_of_reading_rooms_or_percentiles_of_the_object():
    values = np.r_[np.zeros(3000), np.linspace(0.04, 0.06, 1001)].astype(np.float32)
    found = window_presets(values, "1/mm")
    assert found["Full"][:2] == pytest.approx((0, 0.06))
    assert found["Soft tissue"][:2] == pytest.approx((0.042, 0.058), abs=1e-4)  # 10th to 90th of the object
    known = window_presets(values, "1/mm", water=0.05)
    assert known["Soft tissue"][:2] == pytest.approx((0.05 * 0.84, 0.05 * 1.24))
    photons = window_presets(np.float32(20_000) * np.exp(-50 * values), "photons")
    low, high, _ = next(iter(photons.values()))  # what comes first shows the object, which is dark
    assert (low, high) == pytest.approx((20_000 * np.exp(-3), 20_000 * np.exp(-2)), rel=0.02)
    hu = window_presets(1000 * (values / 0.05 - 1), "HU")
    assert next(iter(hu)) == "Soft tissue"
    assert hu["Soft tissue"][:2] == (-160, 240)
    low, high, _ = window_presets(np.ones(50, dtype=np.float32), "1/mm")["Data"]
    assert low == 1 < high


@pytest.fixture(scope="module")
def address():
    with serving_images(image_payloads([numbered()], ["A"]), loopback_socket(None)) as found:
        yield found


@pytest.mark.parametrize("path", ["/", "/album", "/values/0/0"])
@pytest.mark.parametrize(
    ("token", "headers", "why"),
    [
        ("token=wrong", {}, "token is wrong; open the address"),
        (None, {"Origin": "http://evil.example"}, "origin 'http://evil.example'"),
        (None, {"Host": "evil.example"}, "host 'evil.example'"),
    ],
)
def test_strangers_are_refused(address, path, token, headers, why):
    base, right = address.split("/?")
    answer = httpx.get(f"{base}{path}?{right if token is None else token}", headers=headers)
    assert answer.status_code == 403
    assert why in answer.text


def test_values_come_whole_and_others_are_not_there(address):
    base, token = address.split("/?")
    answer = httpx.get(f"{base}/values/0/0?{token}")
    np.testing.assert_array_equal(np.frombuffer(answer.content, "<i2").reshape(3, 4, 5), numbered().values)
    assert "unsafe" not in httpx.get(address).headers["content-security-policy"]
    for path in ("/values/1/0", "/values/0/1", "/values/-1/0", "/scene", "/socket"):
        assert httpx.get(f"{base}{path}?{token}").status_code == 404


def test_a_scan_beside_a_volume_is_refused():
    panel = pp.Panel((2, 3), (1, 1), (0, 0, 0))
    scan = pp.Scan(np.ones((1, 2, 3)), 2, pp.Views([[0, 0, 100]], panel))
    with pytest.raises(pp.errors.DataError, match="a scan and a volume cannot be compared"):
        pp.view(scan, numbered(), open_browser=False)
    with pytest.raises(pp.errors.DataError, match="water: 20"):
        pp.view(numbered(), water=20, open_browser=False)


def test_the_command_prints_its_address_and_ctrl_c_ends_it_cleanly(tmp_path):
    pp.write_volume(tmp_path / "volume.nii.gz", numbered(unit="1/mm"))
    process = start("view volume.nii.gz --no-browser", tmp_path)
    try:
        line = process.stdout.readline()
        assert "http://127.0.0.1:" in line, line + process.stderr.read()
        assert "ssh -N -L" in process.stdout.readline()
        base, token = line.split()[-1].split("/?")
        assert httpx.get(f"{base}/album?{token}").json()["images"][0]["title"] == "volume.nii.gz"
        process.send_signal(signal.SIGINT)
        rest = "".join(process.communicate(timeout=20))
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0, rest
    assert "closed" in rest
    assert "Traceback" not in rest


def test_a_missing_file_is_named(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("sys.argv", ["palpate", "view", str(tmp_path / "none.nii.gz"), "--no-browser"])
    with pytest.raises(SystemExit) as refusal:
        main()
    assert refusal.value.code == 2
    assert "none.nii.gz: no such file" in capsys.readouterr().err
