"""Segmentation: what a threshold, a seed, a hole mean, in mm and in the volume's unit."""

import nibabel
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import DataError
from palpate.volumes.segmentation import connected_parts, contrast, label_volumes, morphological_opening, otsu

TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
GRID = pp.Grid((16, 20, 24), (2.0, 1.5, 1.0), (10, -20, 30), TURN)


def at(index):
    return GRID.points([index])[0]


def boxes():
    """Two boxes of 0.03 and one of 0.05 1/mm, apart; the large one has a closed void and one open in z."""
    values = np.full(GRID.shape, 0.001, np.float32)
    values[2:9, 2:10, 2:12] = 0.03  # large: 560 voxels
    values[4:6, 4:6, 4:6] = 0.001  # a void of 8
    values[2:9, 7:9, 8:10] = 0.001  # a shaft through all its slices: 28
    values[2:6, 13:18, 2:8] = 0.03  # 120
    values[10:14, 3:7, 15:22] = 0.05  # 112
    return pp.Volume(values, GRID)


def test_thresholds_keep_values_between_them():
    labels = pp.segment(boxes(), 0.02, 0.04, name="soft")
    assert np.count_nonzero(labels.values) == 560 - 8 - 28 + 120
    assert labels.names == {1: "soft"}
    assert labels.grid == GRID
    assert label_volumes(labels) == {1: pytest.approx(644 * 3 / 1000)}


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.floats(-50, 50), st.floats(1, 100), st.integers(0, 2**32 - 1))
def test_otsu_parts_two_populations_wherever_they_lie(low, gap, seed):
    rng = np.random.default_rng(seed)
    share = rng.uniform(0.1, 0.9)
    high = rng.random(4000) < share
    values = low + gap * high + rng.normal(0, gap / 20, 4000)
    assert np.mean((values > otsu(values)) == high) > 0.995


def test_otsu_is_the_default():
    labels = pp.segment(boxes())
    assert np.count_nonzero(labels.values) == 560 - 8 - 28 + 120 + 112


def test_largest_seed_and_least_volume_choose_parts():
    assert np.count_nonzero(pp.segment(boxes(), 0.02, keep="largest").values) == 524
    assert np.count_nonzero(pp.segment(boxes(), 0.02, seed=at((3, 15, 5))).values) == 120
    both = pp.segment(boxes(), 0.02, seed=[at((3, 15, 5)), at((11, 4, 18))])
    assert np.count_nonzero(both.values) == 232
    assert np.count_nonzero(pp.segment(boxes(), 0.02, least_volume=115 * 3.0).values) == 644


def test_holes_are_filled_in_space_or_slice_by_slice():
    assert np.count_nonzero(pp.segment(boxes(), 0.02, keep="largest", fill_holes=True).values) == 532
    assert np.count_nonzero(pp.segment(boxes(), 0.02, keep="largest", fill_slices=True).values) == 560


def test_opening_cuts_a_bridge_and_leaves_the_bodies():
    grid = pp.Grid((21, 21, 44), (1, 1, 1))
    place = np.moveaxis(np.indices(grid.shape), 0, -1)
    bodies = np.minimum(*(np.linalg.norm(place - [10, 10, x], axis=-1) for x in (11, 32))) < 8
    bridge = np.zeros_like(bodies)
    bridge[9:12, 9:12, 11:33] = True
    cut = morphological_opening(bodies | bridge, grid, 3.0)
    assert len(connected_parts(bodies | bridge, grid)) == 1
    first, second = connected_parts(cut, grid)
    assert first.volume == pytest.approx(bodies.sum() / 2, rel=0.06)
    assert abs(first.centre[0] - second.centre[0]) == pytest.approx(21, abs=0.5)
    assert not (cut & ~(bodies | bridge)).any()


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.floats(0.5, 3.0))
def test_opening_is_no_more_than_the_mask(seed, radius):
    grid = pp.Grid((9, 10, 11), (1.5, 1, 1))
    from scipy import ndimage

    mask = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=grid.shape), 1) > 0
    once = morphological_opening(mask, grid, radius)
    assert not (once & ~mask).any()


def test_a_lump_is_added_inside_an_organ():
    values = boxes().values.copy()
    values[5:8, 3:6, 9:11] = 0.06
    volume = pp.Volume(values, GRID)
    organ = pp.segment(volume, 0.02, keep="largest", fill_holes=True, name="organ")
    both = pp.segment(volume, 0.045, onto=organ, inside="organ", name="lump")
    assert both.names == {1: "organ", 2: "lump"}
    assert np.count_nonzero(both.values == 2) == 18  # not the box of 0.05 outside
    assert np.count_nonzero(both.values) == np.count_nonzero(organ.values)


def test_segmentation_turns_with_the_volume():
    volume = boxes()
    flipped = pp.Volume(volume.values[::-1, :, ::-1].copy(), GRID)
    one = pp.segment(volume, 0.02, keep="largest", fill_holes=True, opening=1.0)
    two = pp.segment(flipped, 0.02, keep="largest", fill_holes=True, opening=1.0)
    np.testing.assert_array_equal(two.values, one.values[::-1, :, ::-1])


def test_smoothing_bridges_noise_that_a_threshold_alone_would_not():
    rng = np.random.default_rng(0)
    truth = boxes().values > 0.02
    noisy = pp.Volume(boxes().values + rng.normal(0, 0.015, GRID.shape), GRID)
    plain = pp.segment(noisy, 0.016).values > 0
    smooth = pp.segment(noisy, 0.016, smooth=1.2).values > 0
    assert np.mean(smooth == truth) > np.mean(plain == truth) + 0.05


def test_parts_come_by_volume_with_their_centres_in_mm():
    parts = connected_parts(boxes().values > 0.02, GRID)
    assert [round(p.volume / 3) for p in parts] == [524, 120, 112]
    np.testing.assert_allclose(parts[2].centre, GRID.points([[11.5, 4.5, 18]])[0])
    assert [round(p.volume / 3) for p in connected_parts(boxes().values > 0.02, GRID, 115 * 3)] == [524, 120]


def test_contrast_finds_a_bright_ball_in_noise():
    grid = pp.Grid((30, 30, 30), (1, 1, 1))
    rng = np.random.default_rng(4)
    place = np.moveaxis(np.indices(grid.shape), 0, -1)
    values = 0.02 + 0.0003 * place[..., 2] + rng.normal(0, 0.003, grid.shape)  # the far end is brighter than the ball
    values[np.linalg.norm(place - [12, 17, 9], axis=-1) < 3] += 0.006
    mask = np.linalg.norm(place - 14.5, axis=-1) < 13
    score = contrast(pp.Volume(values, grid), mask, 1.8, 6.0)
    assert np.linalg.norm(np.array(np.unravel_index(np.argmax(score), grid.shape)) - [12, 17, 9]) < 1.8
    away = np.linalg.norm(place - [12, 17, 9], axis=-1) > 6
    assert score.max() > 1.25 * score[away].max()
    assert (score[~mask] == 0).all()


def refused(words, *args, **options):
    with pytest.raises(DataError) as refusal:
        pp.segment(boxes(), *args, **options)
    for word in words:
        assert word in str(refusal.value), str(refusal.value)


def test_refusals_name_the_value_and_the_way_out():
    refused(["'bone'", "from 0.2 to inf 1/mm", "0.001 to 0.05", "choose thresholds"], 0.2, name="bone")
    refused(["lower 0.05", "upper 0.02", "swap them"], 0.05, 0.02)
    refused(["lower must be a number", "nan"], np.nan)
    refused(["smooth must be 0 or more", "-1"], 0.02, smooth=-1)
    refused(["keep is 'all' or 'largest'", "'some'"], 0.02, keep="some")
    refused(["least_volume 5000 mm³", "1572", "lower it"], 0.02, least_volume=5000)
    refused(["opening leaves nothing", "smaller radius"], 0.02, opening=50)
    refused(["seed", "outside the volume", "corners"], 0.02, seed=(900, 0, 0))
    refused(["on no voxel within the thresholds", "nearest", str(at((2, 2, 2)).tolist())], 0.02, seed=at((0, 1, 2)))
    refused(["x, y, z in mm"], 0.02, seed=(1, 2))
    refused(["inside='organ'", "onto"], 0.02, inside="organ")
    organ = pp.segment(boxes(), 0.02)
    refused(["already hold 'organ'", "another name"], 0.045, onto=organ)
    refused(["'spleen' is absent"], 0.045, onto=organ, inside="spleen", name="lump")
    elsewhere = pp.Labels(organ.values, pp.Grid(GRID.shape, (1, 1, 1)))
    refused(["another grid", "resample"], 0.045, onto=elsewhere)
    constant = pp.Volume(np.ones(GRID.shape, np.float32), GRID)
    with pytest.raises(DataError, match="all values are 1, no threshold parts them; give lower or upper"):
        pp.segment(constant)


def test_the_command_writes_labels_that_nibabel_opens(tmp_path):
    pp.write_volume(tmp_path / "v.nii.gz", boxes())
    seed = ",".join(str(x) for x in at((3, 3, 3)))
    words = ["segment", tmp_path / "v.nii.gz", "-o", tmp_path / "l.nii.gz", "--lower", 0.02, "--seed", seed]
    result = CliRunner().invoke(app, [str(w) for w in [*words, "--fill-holes", "--name", "organ"]])
    assert result.exit_code == 0, result.output
    assert "1 (organ): 1.60 ml" in result.output
    stored = nibabel.load(tmp_path / "l.nii.gz")
    assert np.count_nonzero(np.asarray(stored.dataobj)) == 532
    centre = np.argwhere(np.asarray(stored.dataobj)).mean(axis=0)
    expected = pp.segment(boxes(), 0.02, keep="largest", fill_holes=True)
    lps = GRID.points(np.argwhere(expected.values)).mean(axis=0)
    ras = (stored.affine @ [*centre, 1])[:3]
    np.testing.assert_allclose(ras, lps * [-1, -1, 1], atol=1e-3)


def test_the_command_refuses_before_it_writes(tmp_path):
    pp.write_volume(tmp_path / "v.nii.gz", boxes())
    out = tmp_path / "l.nii.gz"
    for options in (["--lower", "9"], ["--lower", "0.02", "--seed", "1,2"], ["--seed", "a,b,c"]):
        result = CliRunner().invoke(app, ["segment", str(tmp_path / "v.nii.gz"), "-o", str(out), *options])
        assert isinstance(result.exception, DataError)
        assert not out.exists()


def test_a_registered_method_finds_what_it_says(monkeypatch):
    """And no thresholds go with it."""
    monkeypatch.setattr("palpate.volumes.segmentation.names", lambda kind: ("threshold", "halves"))
    monkeypatch.setattr("palpate.volumes.segmentation.part", lambda kind, name: lambda v: v.values == 0.5)
    values = np.zeros((4, 5, 6))
    values[2, 3, 4], values[1, 1, 1] = 0.5, 1.0
    volume = pp.Volume(values, pp.Grid(values.shape, (1, 1, 1)))
    assert np.argwhere(pp.segment(volume, method="halves").values).tolist() == [[2, 3, 4]]
    with pytest.raises(pp.errors.DataError, match="takes no thresholds"):
        pp.segment(volume, lower=0.5, method="halves")
