"""A reader of your own in one file.

It reads MRC files, in which microscopes store volumes (Cheng et al., J. Struct. Biol. 192:146, 2015). For the commands:

    palpate --plugin examples/own_reader.py segment cells.mrc -o labels.nii.gz
"""

import numpy as np

import palpate as pp
from palpate.errors import FileError

KINDS = {0: np.int8, 1: np.int16, 2: np.float32, 6: np.uint16}  # of the values, by the header's mode
ANGSTROM = 1e-7  # mm


@pp.register_reader(".mrc")
def read_mrc(path):
    """The volume; its unit is the file's own."""
    header = path.read_bytes()[:1024]
    if len(header) < 1024 or header[208:211] != b"MAP":
        raise FileError(f"{path}: not an MRC file")
    columns, rows, sections, mode = np.frombuffer(header, "<i4", 4)
    intervals, cell = np.frombuffer(header, "<i4", 3, 28), np.frombuffer(header, "<f4", 3, 40)
    origin, extended = np.frombuffer(header, "<f4", 3, 196), int(np.frombuffer(header, "<i4", 1, 92)[0])
    if mode not in KINDS or (np.frombuffer(header, "<i4", 3, 64) != (1, 2, 3)).any():
        raise FileError(f"{path}: mode {mode} or its order of axes is not read")
    shape = (sections, rows, columns)
    values = np.fromfile(path, np.dtype(KINDS[mode]).newbyteorder("<"), int(np.prod(shape)), offset=1024 + extended)
    spacing = cell / intervals * ANGSTROM
    return pp.Volume(values.reshape(shape), pp.Grid(shape, spacing[::-1], origin * ANGSTROM), "MRC")


if __name__ == "__main__":
    import sys
    from pathlib import Path

    for name in sys.argv[1:]:
        volume = read_mrc(Path(name))
        print(f"{name}: {volume.grid.shape} voxels (z, y, x) of {volume.grid.spacing} mm")
