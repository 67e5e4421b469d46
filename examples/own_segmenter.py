"""A segmenter of your own in one file: python examples/own_segmenter.py

It removes noise by total variation (Rudin, Osher & Fatemi, Physica D 60:259, 1992) before it takes a threshold, so that it
finds parts that noise hides from any threshold. For the command:

    palpate --plugin examples/own_segmenter.py segment ct.nii.gz -o labels.nii.gz --method total-variation --largest
"""

import numpy as np
from skimage.filters import threshold_otsu
from skimage.restoration import denoise_tv_chambolle

import palpate as pp


@pp.register_segmenter("total-variation")
def total_variation(volume):
    """The mask of the brighter part."""
    values = volume.values.astype(np.float64)
    noise = np.median(np.abs(np.diff(values, axis=2))) / 0.954  # of neighbours' differences, per voxel
    smooth = denoise_tv_chambolle(values / max(noise, 1e-12), weight=2.0)
    return smooth > threshold_otsu(smooth)


def noisy_ball(radius=12.0):
    """A volume of a ball of 0.024 1/mm in 0.02 1/mm, with noise as large as the difference, and where the ball is."""
    grid = pp.Grid((40, 40, 40), (1, 1, 1), (0, 0, 0))
    z, y, x = np.indices(grid.shape)
    ball = (x - 20) ** 2 + (y - 19) ** 2 + (z - 21) ** 2 < radius**2
    noise = np.random.default_rng(1).normal(0, 0.004, grid.shape)
    return pp.Volume(0.02 + 0.004 * ball + noise, grid), ball


def main():
    """Gives the overlap (Dice's coefficient) with the ball, by method."""
    volume, ball = noisy_ball()
    overlap = {}
    for method in ("threshold", "total-variation"):
        found = pp.segment(volume, method=method).values > 0
        overlap[method] = 2 * np.count_nonzero(found & ball) / (np.count_nonzero(found) + np.count_nonzero(ball))
    return overlap


if __name__ == "__main__":
    for method, overlap in main().items():
        print(f"{method}: overlap {overlap:.3f}")
