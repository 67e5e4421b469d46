"""What each command refuses, end to end: name, value and way out are said in time, and no output is touched."""

import hashlib
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from support import broken_files

import palpate as pp
from palpate.commands import main

OLD = b"an older result"
OUTPUTS = ("out.h5", "out.nii.gz", "out.vtu", "out.yaml")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shelf")
    broken_files.fill(folder)
    return folder


def state(folder):
    """Names and contents of all files."""
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*") if p.is_file()
    }


def palpate(words, monkeypatch, capsys):
    """Exit code, stdout and stderr of the command, in this process; boxes and line breaks taken out of stderr."""
    monkeypatch.setattr(sys, "argv", ["palpate", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    return ended.value.code or 0, said.out, " ".join(said.err.translate({ord(c): " " for c in "│╭╮╰╯─"}).split())


IMPORT = "scan import {} --geometry {} -o out.h5"
RECONSTRUCT = "reconstruct {} -o out.nii.gz --thickness 4"
LIKE = "reconstruct scan.h5 -o out.nii.gz --like {}"
SEGMENT = "segment {} -o out.nii.gz --lower 0.02"
MESH = "mesh {} --label {} -o out.vtu"
FIT = "fit {} --young 5 -o out.vtu"
UNDER_A_FILE = "file/sub/out"
# The case, named for the line of the promise: (words, what stderr must hold: name, value, way out).
REFUSED = {
    "scan import: missing file": (IMPORT.format("none.npy", "g.yaml"), ["none.npy", "no such file", "check the name"]),
    "scan import: missing geometry": (IMPORT.format("stack.npy", "no.yaml"), ["no.yaml", "no such file", "check"]),
    "scan import: wrong shape": (
        IMPORT.format("two.npy", "g.yaml"),
        ["two.npy", "(2, 4, 5)", "(3, 4, 5)", "check panel"],
    ),
    "scan import: wrong dtype": (IMPORT.format("complex.npy", "g.yaml"), ["complex.npy", "complex128", "export it as"]),
    "scan import: NaN": (IMPORT.format("nan.npy", "g.yaml"), ["nan.npy", "(1, 2, 3): nan", "mask or replace"]),
    "scan import: negative counts": (
        IMPORT.format("negative.npy", "g.yaml"),
        ["negative.npy", "counts", "view 1, row 2, column 3: -7", "mask them"],
    ),
    "scan import: zero incident": (
        IMPORT.format("stack.npy", "dark.yaml"),
        ["incident", "0 or less", "mask dead pixels"],
    ),
    "scan import: a 60 m source": (
        IMPORT.format("stack.npy", "far.yaml"),
        ["far.yaml", "source", "60", "check the units"],
    ),
    "scan import: truncated raw": (
        IMPORT.format("cut-stack.raw", "raw.yaml"),
        ["cut-stack.raw", "72 bytes, 120", "check"],
    ),
    "scan import: truncated npy": (IMPORT.format("cut-stack.npy", "g.yaml"), ["cut-stack.npy", "not a whole", "again"]),
    "scan simulate: no photons": ("scan simulate --incident 0 -o out.h5", ["incident", ": 0)", "mask"]),
    "scan simulate: a 60 m source": (
        "scan simulate --distance 60000 -o out.h5",
        ["source of view 0", "60 m", "check the units"],
    ),
    "reconstruct: missing file": (RECONSTRUCT.format("none.h5"), ["none.h5", "no such file", "check the name"]),
    "reconstruct: another kind of file": (
        RECONSTRUCT.format("text.h5"),
        ["text.h5", "not an HDF5", "palpate scan import"],
    ),
    "reconstruct: truncated h5": (
        RECONSTRUCT.format("cut-scan.h5"),
        ["cut-scan.h5", "truncated", "palpate scan import"],
    ),
    "reconstruct: wrong shape": (
        RECONSTRUCT.format("flat.h5"),
        ["flat.h5", "/counts", "(4, 5)", "expected shape (views"],
    ),
    "reconstruct: another number of views": (RECONSTRUCT.format("two.h5"), ["two.h5", "(3, 4, 5)", "(2, 4, 5)"]),
    "reconstruct: wrong dtype": (RECONSTRUCT.format("complex.h5"), ["complex.h5", "counts", "complex128", "convert"]),
    "reconstruct: NaN": (RECONSTRUCT.format("nan.h5"), ["nan.h5", "counts", "(1, 2, 3): nan", "mask or replace"]),
    "reconstruct: negative counts": (
        RECONSTRUCT.format("negative.h5"),
        ["negative.h5", "counts", ": -7)", "mask them"],
    ),
    "reconstruct: zero incident": (RECONSTRUCT.format("dark.h5"), ["dark.h5", "incident", ": 0)", "mask dead pixels"]),
    "reconstruct: a 60 m source": (RECONSTRUCT.format("far.h5"), ["far.h5", "source", "60 m", "check the units"]),
    "reconstruct: geometry that misses the volume": (
        LIKE.format("aside.nii.gz"),
        ["geometry misses the volume", "columns", "check the grid's origin"],
    ),
    "reconstruct: volume above the source": (
        LIKE.format("above.nii.gz"),
        ["715.5", "focal spot of view", "lower the"],
    ),
    "reconstruct: truncated volume to be like": (
        LIKE.format("cut-ct.nii.gz"),
        ["cut-ct.nii.gz", "not a whole", "again"],
    ),
    "reconstruct: no thickness": ("reconstruct scan.h5 -o out.nii.gz", ["thickness", "got None", "--thickness"]),
    "reconstruct: negative thickness": (
        "reconstruct scan.h5 -o out.nii.gz --thickness -3",
        ["thickness", "-3", "--thickness"],
    ),
    "reconstruct: voxels of nothing": (RECONSTRUCT.format("scan.h5") + " --spacing 0", ["spacing", "0", "mm"]),
    "reconstruct: voxels of nanometres": (
        RECONSTRUCT.format("scan.h5") + " --spacing 0.0001",
        ["spacing", "0.0001 mm", "give a larger one"],
    ),
    "reconstruct: negative strength": (
        RECONSTRUCT.format("scan.h5") + " --strength -1",
        ["strength", "-1", "0 or more"],
    ),
    "reconstruct: a cut-off beyond Nyquist": (
        RECONSTRUCT.format("scan.h5") + " --method fbp --cutoff 1.5",
        ["cutoff", "1.5", "Nyquist"],
    ),
    "reconstruct: a relaxation that diverges": (
        RECONSTRUCT.format("scan.h5") + " --method sart --relaxation 2",
        ["relaxation", "2.0", "below 2"],
    ),
    "reconstruct: a region that is none": (
        RECONSTRUCT.format("scan.h5") + " --region 1,2,3",
        ["region", "'1,2,3'", "x0,x1,y0,y1,z0,z1"],
    ),
    "reconstruct: a region beyond the grid": (
        RECONSTRUCT.format("scan.h5") + " --region 0,900,0,1,0,1",
        ["region", "900.0", "reaches beyond the grid", "choose it inside"],
    ),
    "reconstruct: no level": (RECONSTRUCT.format("scan.h5") + " --levels 0", ["levels", "0", "at least 1"]),
    "reconstruct: no iteration": (RECONSTRUCT.format("scan.h5") + " --iterations 0", ["iterations", "0", "at least 1"]),
    "reconstruct: no checkpoint": (RECONSTRUCT.format("scan.h5") + " --resume", ["out.nii.gz", "leave out --resume"]),
    "reconstruct: truncated checkpoint": (
        "reconstruct scan.h5 -o cut.nii.gz --thickness 4 --resume",
        ["cut.nii.gz.checkpoint.h5", "truncated", "start afresh"],
    ),
    "reconstruct: another file as checkpoint": (
        "reconstruct scan.h5 -o scan.nii.gz --thickness 4 --resume",
        ["scan.nii.gz.checkpoint.h5", "not a checkpoint", "leave out --resume"],
    ),
    "reconstruct: unknown format": (
        "reconstruct scan.h5 -o out.png --thickness 4",
        ["out.png", "cannot tell", ".nii.gz"],
    ),
    "segment: missing file": (SEGMENT.format("none.nii.gz"), ["none.nii.gz", "no such file", "check the name"]),
    "segment: unknown format": (SEGMENT.format("stack.npy"), ["stack.npy", "cannot tell the format", ".nii.gz"]),
    "segment: wrong shape": (SEGMENT.format("four.nii.gz"), ["four.nii.gz", "12, 14, 16", "save one volume a file"]),
    "segment: wrong dtype": (SEGMENT.format("complex.nii.gz"), ["complex.nii.gz", "complex64", "split the channels"]),
    "segment: NaN": (SEGMENT.format("nan.nii.gz"), ["nan.nii.gz", "1 values are not finite", "nan_to_num"]),
    "segment: 60 m voxels": (SEGMENT.format("far.nii.gz"), ["far.nii.gz", "60000", "check the units"]),
    "segment: truncated nii.gz": (SEGMENT.format("cut-ct.nii.gz"), ["cut-ct.nii.gz", "not a whole", "again"]),
    "segment: truncated mha": (SEGMENT.format("cut-ct.mha"), ["cut-ct.mha", "again"]),
    "segment: truncated nrrd": (SEGMENT.format("cut-ct.nrrd"), ["cut-ct.nrrd", "again"]),
    "segment: empty mask": (
        "segment ct.nii.gz -o out.nii.gz --lower 3 --name bone",
        ["'bone'", "from 3 to inf", "0 to 0.05", "choose thresholds"],
    ),
    "segment: label absent": (
        "segment ct.nii.gz -o out.nii.gz --lower 0.02 --onto organ.nii.gz --inside liver",
        ["'liver' is absent", "1 (kidney_left)"],
    ),
    "mesh: missing file": (MESH.format("none.nii.gz", "1"), ["none.nii.gz", "no such file", "check the name"]),
    "mesh: truncated nii.gz": (MESH.format("cut-labels.nii.gz", "1"), ["cut-labels.nii.gz", "not a whole", "again"]),
    "mesh: wrong dtype": (
        MESH.format("fraction.nii.gz", "1"),
        ["fraction.nii.gz", "float", "segment the volume first"],
    ),
    "mesh: label absent": (
        MESH.format("labels.nii.gz", "kidney"),
        ["'kidney' is absent", "1 (kidney_left), 3 (lump)"],
    ),
    "mesh: empty mask": (MESH.format("empty.nii.gz", "1"), ["label '1' is absent", "none", "segment the volume again"]),
    "mesh: inclusion absent": (
        MESH.format("labels.nii.gz", "1") + " --inclusion cyst",
        ["'cyst' is absent", "3 (lump)"],
    ),
    "mesh: mask touching the border": (
        MESH.format("border.nii.gz", "kidney_left"),
        ["'kidney_left' touches the border", "576 voxels in the", "--closed-at-border"],
    ),
    "mesh: edge of nothing": (
        MESH.format("labels.nii.gz", "1") + " --edge 0",
        ["edge", "0.0", "positive length in mm"],
    ),
    "fit: missing file": (FIT.format("none.vtu"), ["none.vtu", "no such file", "check the name"]),
    "fit: truncated vtu": (FIT.format("cut-mesh.vtu"), ["cut-mesh.vtu", "truncated", "write it again"]),
    "fit: truncated msh": (FIT.format("cut-mesh.msh"), ["cut-mesh.msh", "truncated", "write it again"]),
    "fit: a skin, no solid": (FIT.format("skin.vtu"), ["skin.vtu", "triangle", "mesh the solid"]),
    "fit: NaN": (FIT.format("nan.vtu"), ["nan.vtu", "nodes", "not finite", "replace"]),
    "fit: non-manifold mesh": (FIT.format("pinched.vtu"), ["pinched.vtu", "1 nodes", "split the mesh"]),
    "fit: flat mesh": (FIT.format("flat.vtu"), ["flat.vtu", "tet 0", "remove them or mesh again"]),
    "fit: inverted mesh": (FIT.format("folded.vtu"), ["folded.vtu", "inverted", "tets", "mesh it again"]),
    "fit: negative stiffness": (
        "fit mesh.vtu --young -3 -o out.vtu",
        ["young", "-3 kPa", "give a positive stiffness"],
    ),
    "fit: negative stiffness of a region": (
        "fit mesh.vtu --young 3 --region-young 1=-20 -o out.vtu",
        ["young", "-20 kPa", "give a positive stiffness"],
    ),
    "fit: Poisson's ratio of 0.5": (
        "fit mesh.vtu --young 3 --poisson 0.5 -o out.vtu",
        ["poisson", "0.5 at tet", "0 <= poisson < 0.5", "give 0.45"],
    ),
    "fit: Poisson's ratio below 0": (
        "fit mesh.vtu --young 3 --poisson -0.1 -o out.vtu",
        ["poisson", "-0.1 at tet", "give 0.45"],
    ),
    "fit: region absent": (
        "fit mesh.vtu --young 3 --region-young lump=20 -o out.vtu",
        ["lump=20", "regions 1"],
    ),
    "touch: missing file": ("touch none.vtu", ["none.vtu", "no such file", "check the name"]),
    "touch: truncated vtu": ("touch cut-tissue.vtu", ["cut-tissue.vtu", "truncated", "again"]),
    "touch: a mesh, no tissue": ("touch mesh.vtu", ["mesh.vtu", "without young, poisson", "palpate fit mesh.vtu"]),
    "touch: unknown model": ("touch tissue.vtu --model jelly", ["model", "'jelly'", "springs"]),
    "touch: toughness of no region": (
        "touch tissue.vtu --region-toughness lump=900",
        ["--region-toughness", "lump=900", "regions 1"],
    ),
    "touch: radius of nothing": (
        "touch tissue.vtu --radius -2",
        ["radius", "-2", "expected more than 0", "leave it out"],
    ),
    "touch: truncated record": ("touch tissue.vtu --replay cut-session.h5", ["cut-session.h5", "truncated", "again"]),
    "touch: missing record": ("touch tissue.vtu --replay none.h5", ["none.h5", "no such file", "--record"]),
    "touch: impossible port": ("touch tissue.vtu --port 70000", ["70000", "1 to 65535", "--port"]),
    "demo: a lump that is not there": ("demo kidney --training", ["--training", "kidney", "only the breast has"]),
    "demo: what another demo left": (
        "demo kidney --no-browser -o breast-demo",
        ["breast-demo", "'breast, palpate", "not 'kidney", "choose another folder"],
    ),
    "demo: unknown sample": ("demo liver", ["'liver'", "breast", "kidney"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_name_value_and_way_out(files, monkeypatch, capsys, case):
    words, parts = REFUSED[case]
    monkeypatch.chdir(files)
    for name in OUTPUTS:
        (files / name).write_bytes(OLD)
    before = state(files)
    code, _, said = palpate(words.split(), monkeypatch, capsys)
    for part in parts:
        assert part in said, said
    assert code == 2
    assert "Traceback" not in said
    assert len(said) < 700, "a refusal is read by people"
    assert state(files) == before, "an output was touched, or a temporary left"


def explode(*arguments, **options):
    pytest.fail("work was begun before the refusal")


UNWRITABLE = {
    "scan import": ("scan import stack.npy --geometry g.yaml -o {}.h5", "import_scan"),
    "scan simulate": ("scan simulate -o {}.h5", "simulate_scan"),
    "scan template": ("scan template -o {}.yaml", None),
    "reconstruct": ("reconstruct scan.h5 -o {}.nii.gz --thickness 4", "iterates"),
    "segment": ("segment ct.nii.gz -o {}.nii.gz", "segment"),
    "mesh": ("mesh labels.nii.gz --label 1 -o {}.vtu", "tetrahedralize"),
    "fit": ("fit mesh.vtu --young 5 -o {}.vtu", "fit"),
    "touch": ("touch tissue.vtu --no-browser --record {}.h5", "Session"),
}


@pytest.mark.parametrize("target", [UNDER_A_FILE, "none/out", "/proc/out"])
@pytest.mark.parametrize("command", UNWRITABLE)
def test_an_output_that_cannot_be_written_is_refused_before_any_work(files, monkeypatch, capsys, command, target):
    words, work = UNWRITABLE[command]
    monkeypatch.chdir(files)
    if work:
        monkeypatch.setattr(pp, work, explode)
    before = state(files)
    code, _, said = palpate(words.format(target).split(), monkeypatch, capsys)
    folder = str(Path(target).parent)
    assert code == 2
    assert f"folder {folder} " in said, said
    assert "mkdir -p" in said or "choose another folder" in said
    assert state(files) == before


@pytest.mark.parametrize("folder", ["file/sub", "file", "/proc/demo"])
def test_a_demo_folder_that_cannot_be_made_is_refused_before_any_work(files, monkeypatch, capsys, folder):
    monkeypatch.chdir(files)
    before = state(files)
    code, _, said = palpate(["demo", "kidney", "--no-browser", "-o", folder], monkeypatch, capsys)
    assert code == 2
    assert folder in said
    assert "choose another" in said
    assert state(files) == before


@pytest.mark.parametrize("words", ["touch tissue.vtu", "demo kidney -o demo"])
def test_a_port_in_use_is_refused_before_any_work(files, monkeypatch, capsys, words):
    monkeypatch.chdir(files)
    monkeypatch.setattr(pp, "run_demo", explode, raising=False)
    before = state(files)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        code, _, said = palpate([*words.split(), "--port", port], monkeypatch, capsys)
    assert code == 2
    for part in (f"port {port}", "in use", "--port"):
        assert part in said, said
    assert state(files) == before
    assert not (files / "demo").exists()


@pytest.mark.parametrize(
    "case", ["scan import: negative counts", "mesh: mask touching the border", "touch: truncated vtu"]
)
def test_the_program_itself_ends_with_one_line_and_no_traceback(files, case):
    words, parts = REFUSED[case]
    here = {**os.environ, "PYTHONPATH": str(Path(pp.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "-m", "palpate", *words.split()], cwd=files, env=here, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr.startswith("palpate: ")
    assert len(done.stderr.strip().splitlines()) == 1
    assert all(part in done.stderr for part in parts)
    assert done.stdout == ""


def test_what_the_library_warns_of_is_a_line_for_people(files, monkeypatch, capsys):
    """A mesh whose tets run the other way round is turned, and that is said, not where in the source."""
    import meshio
    from support.brick_meshes import brick

    mesh = brick((3, 3, 3))
    monkeypatch.chdir(files)
    meshio.Mesh(mesh.nodes, [("tetra", mesh.tets[:, [1, 0, 2, 3]])]).write("turned.vtu")
    code, _, said = palpate(["fit", "turned.vtu", "--young", 5, "-o", "turned-tissue.vtu"], monkeypatch, capsys)
    assert code == 0
    assert "note: turned.vtu: 162 of 162 tets were inverted: turned" in said
    assert ".py" not in said
    assert pp.read_tissue("turned-tissue.vtu").mesh.volumes.sum() == pytest.approx(50.0**3)


def test_a_full_disk_is_one_line(files, monkeypatch, capsys):
    monkeypatch.chdir(files)

    def full(*arguments):
        raise OSError(28, "No space left on device", "out.h5")

    monkeypatch.setattr(pp, "write_scan", full)
    words = ["scan", "import", "stack.npy", "--geometry", "g.yaml", "-o", "out.h5"]
    code, _, said = palpate(words, monkeypatch, capsys)
    assert code == 1
    assert "No space left on device: 'out.h5'" in said
    assert "Traceback" not in said


def test_the_nearest_labels_are_named_first_and_the_rest_counted():
    import numpy as np

    names = {v: f"vertebra_T{v}" for v in range(1, 60)} | {60: "kidney_left", 61: "kidney_right"}
    labels = pp.Labels(np.arange(62).reshape(1, 1, 62), pp.Grid((1, 1, 62), (1, 1, 1)), names)
    with pytest.raises(
        ValueError, match=r"'kidny_left' is absent; labels present: 60 \(kidney_left\), 61 \(kidney_ri"
    ) as no:
        labels.value_of("kidny_left")
    assert "and 55 more" in str(no.value)
    assert len(str(no.value)) < 250
