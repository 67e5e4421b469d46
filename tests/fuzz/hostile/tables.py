"""HDF5 files that lie: scans, and records of sessions."""

import shutil
import struct
import zlib

import h5py
import numpy as np
from support.brick_meshes import brick

import palpate as pp
from fuzz.hostile.ways import COMMANDS, VALID, case, pick, special, zeros

COMMANDS["scan"] = "reconstruct NAME -o out.nii.gz --method backprojection --thickness 40"
COMMANDS["record"] = "score NAME tissue.vtu -o out.html"
NUMBERS = {"scan": ("counts", "incident", "background", "mask", "views/source", "views/panel/pitch"), "record": ()}
NUMBERS["record"] = (
    "ticks",
    "tools",
    "kinds",
    "points",
    "displacements",
    "digest_ticks",
    "digests",
    "switches",
    "lacking",
)
OTHERS = {"scan": ("views", "views/panel"), "record": ("changes", "marks", "settings")}
LARGE = {"scan": "counts", "record": "points"}


def tissue():
    mesh = brick((2, 2, 2), (10, 10, 10))
    return pp.fit(mesh, 5, 0.4, pp.resting_on(mesh, (0, 0, -1)))


def valid(folder):
    """What every case starts from: scan.h5, record.h5 and the tissue that it was made on."""
    panel = pp.Panel((24, 32), (2, 2), (-32, -24, 0))
    counts = np.random.default_rng(0).poisson(1000, (5, 24, 32))
    pp.write_scan(folder / "scan.h5", pp.Scan(counts, 2000, pp.arc_views(panel, range(-20, 21, 10), radius=600)))
    soft = tissue()
    session = pp.Session(pp.model(soft, "compliance"), radius=5, sweeps=5)
    session.step([pp.Command(True, (5, 5, 10), (0, 0, -0.02 * i)) for i in range(50)])
    pp.write_record(folder / "record.h5", session.record())
    pp.write_tissue(folder / "tissue.vtu", soft)


def start(folder, rng, form):
    """A copy of the valid file, to be spoilt."""
    path = folder / f"{form}.h5"
    shutil.copy(folder.parent / "valid" / path.name, path)
    if form == "record":
        shutil.copy(folder.parent / "valid" / "tissue.vtu", folder)
    return path


def swelling(folder, rng, form):
    path, name, kind = start(folder, rng, form), LARGE[form], int(rng.integers(4))
    if kind == 3:
        path.write_bytes(path.read_bytes()[: -int(rng.integers(1, 2000))])
        return path.name
    with h5py.File(path, "r+") as file:
        shape, number = file[name].shape, file[name].dtype
        del file[name]
        made = file.create_dataset(name, shape, number, chunks=shape, compression=1, shuffle=kind == 1)
        whole = bytes(made.nbytes)
        if kind < 2:  # a chunk of 4 GB
            packed = zlib.compress(b"")[:2] + zlib.compressobj(1, zlib.DEFLATED, -15).flush(zlib.Z_FULL_FLUSH)
            packed += zeros() * 4096
        else:
            packed = zlib.compress(whole)[: int(rng.integers(8, 20))]
        made.id.write_direct_chunk((0,) * len(shape), packed)
    return path.name


def special_file(folder, rng, form):
    path = start(folder, rng, form)
    kind = int(rng.integers(4))
    if kind < 2:
        special(path, rng)
        return path.name
    with h5py.File(path, "r+") as file:
        name = LARGE[form]
        shape, number = file[name].shape, file[name].dtype
        del file[name]
        if kind == 2:  # its numbers lie in a device
            device = pick(rng, (b"/dev/zero", b"/dev/urandom", b"/etc/passwd"))
            space, way = h5py.h5s.create_simple(shape), h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            way.set_external(device, 0, h5py.h5f.UNLIMITED)
            h5py.h5d.create(file.id, name.encode(), h5py.h5t.py_create(number), space, dcpl=way)
        else:
            file[name] = h5py.ExternalLink(pick(rng, ("/dev/zero", "none.h5", ".", "pipe")), "/counts")
    if kind == 3:
        special(folder / "pipe", rng)
    return path.name


def huge(folder, rng, form):
    path = start(folder, rng, form)
    name = pick(rng, NUMBERS[form][:1] + NUMBERS[form])
    with h5py.File(path, "r+") as file:
        axes, number = file[name].ndim, file[name].dtype
        del file[name]
        sizes = np.ones(axes, np.int64)
        sizes[rng.integers(axes)] = int(rng.integers(2**37, 2**40))
        chunks = tuple(np.minimum(sizes, 1024).tolist()) if rng.random() < 0.7 else None
        made = file.create_dataset(
            name, tuple(sizes.tolist()), number, chunks=chunks, compression=1 if chunks else None
        )
        if chunks:
            made[(slice(0, 1),) * axes] = 1
    return path.name


def wrapping(folder, rng, form):
    """A size within a dataset's header, of eight bytes, is another."""
    path = start(folder, rng, form)
    name = LARGE[form]
    with h5py.File(path, "r+") as file:
        values = file[name][()]
        del file[name]
        sizes = (17, 23, 29)[: values.ndim]  # to be found
        file.create_dataset(name, data=np.resize(values, sizes))
    data = bytearray(path.read_bytes())
    at = data.index(struct.pack(f"<{len(sizes)}Q", *sizes)) + 8 * int(rng.integers(len(sizes)))
    struct.pack_into("<q", data, at, pick(rng, (-1, -23, -(2**63), 2**62, 2**63 - 1, 2**32, 2**61 + 23, 0)))
    path.write_bytes(bytes(data))
    return path.name


def header(folder, rng, form):
    path, kind = start(folder, rng, form), int(rng.integers(5))
    with h5py.File(path, "r+") as file:
        if kind == 0:  # links in a circle
            name = pick(rng, NUMBERS[form])
            del file[name]
            file[name] = h5py.SoftLink("/round")
            file["round"] = h5py.SoftLink(f"/{name}")
        elif kind == 1:  # groups in groups
            del file[LARGE[form]]
            here = file
            for _ in range(int(rng.integers(3000, 6000))):
                here = here.create_group("a")
        elif kind == 2:  # very many of them
            del file[LARGE[form]]
            for i in range(int(rng.integers(20_000, 40_000))):
                file.create_group(f"g{i}")
        elif kind == 3:  # an attribute that is large
            del file.attrs["version"]
            file.attrs["version"] = h5py.Empty("f8") if rng.random() < 0.3 else np.ones(int(rng.integers(2, 8000)))
        else:
            file.attrs["format"] = pick(rng, (["palpate"] * 3, np.zeros((9, 9)), "x" * 60_000, b"\xff\xfe", np.nan))
    return path.name


def content(folder, rng, form):
    """A group for a dataset, a dataset for a group, or one of a kind that is no number."""
    path = start(folder, rng, form)
    name = pick(rng, (*NUMBERS[form], *OTHERS[form]))
    with h5py.File(path, "r+") as file:
        if name not in NUMBERS[form]:
            was = isinstance(file[name], h5py.Group)
            del file[name]
            if was or rng.random() < 0.5:
                file[name] = pick(rng, (1.0, "text", np.arange(3), h5py.Empty("f8")))
            else:
                file.create_group(name)
            return path.name
        shape = tuple(max(n, 1) for n in file[name].shape) or (1,)
        del file[name]
        kind = int(rng.integers(7))
        if kind <= 1:
            file.create_group(name)
        elif kind == 2:
            file.create_dataset(name, data=pick(rng, ("text", b"bytes", [b"a", b"bc"])))
        elif kind == 3:
            file[name] = h5py.Empty(pick(rng, ("f8", "u1")))
        elif kind == 4:
            file[name] = np.zeros(shape, [("a", "f8"), ("b", "i4")])
        elif kind == 5:
            made = file.create_dataset(name, shape, h5py.vlen_dtype(np.float64))
            made[(0,) * len(shape)] = [1.0, 2.0]
        else:
            file[name] = np.full(shape, 1j)
    return path.name


for _form in ("scan", "record"):
    for _kind, _make in (
        ("swelling", swelling),
        ("special", special_file),
        ("2^40", huge),
        ("wrapping", wrapping),
        ("header", header),
        ("content", content),
    ):
        case(_form, _kind)(lambda folder, rng, make=_make, form=_form: make(folder, rng, form))
    VALID[_form] = lambda folder, form=_form: start(folder, None, form).name
