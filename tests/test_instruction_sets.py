"""The hot loops exist for every instruction set that the wheel promises."""

import bisect
import platform
import re
import shutil
import subprocess
from importlib.util import find_spec

import pytest

from palpate import _core

PASSES = ["add_subslice_1", "add_subslice_2", "add_subslice_3"]
PROJECTOR = [*PASSES, "voxel_weights_of_pixels", "pixel_weights_of_voxels"]
TURNED = ["add_pixels", "resample_points"]
DESCENT = ["add_derivatives", "apply_change"]

pytestmark = [
    pytest.mark.skipif(platform.machine() != "x86_64" or platform.system() != "Linux", reason="x86-64 Linux only"),
    pytest.mark.skipif(shutil.which("objdump") is None, reason="objdump is missing: apt install binutils"),
    pytest.mark.skipif(find_spec("palpate._x86_64_level") is not None, reason="made as one module a level"),
]


@pytest.fixture(scope="module")
def versions():
    """Code of every version of each kernel, by the kernel's name.

    The versions themselves have no symbol in a stripped wheel; the resolver that picks one at load time does, and
    takes their addresses.
    """
    lines = subprocess.run(
        ["objdump", "-d", "--no-show-raw-insn", "-C", _core.__file__], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    resolvers: dict[str, set[int]] = {}
    code, starts, resolver = [], set(), None
    for line in lines:
        if head := re.match(r"([0-9a-f]+) <(.+)>:$", line):
            starts.add(int(head[1], 16))
            name = re.match(r"palpate::(?:\w+::)*(\w+)\(.*\[clone \.resolver\]", head[2])
            resolver = name and name[1]
        elif step := re.match(r" *([0-9a-f]+):\t(.*)", line):
            code.append((int(step[1], 16), step[2]))
            if resolver and (target := re.search(r"lea .*# ([0-9a-f]+)", step[2])):
                resolvers.setdefault(resolver, set()).add(int(target[1], 16))
    starts |= {start for targets in resolvers.values() for start in targets}
    addresses, edges = [address for address, _ in code], sorted(starts)

    def body(start):
        after = bisect.bisect_right(edges, start)
        end = edges[after] if after < len(edges) else addresses[-1] + 1
        return "\n".join(
            text for _, text in code[bisect.bisect_left(addresses, start) : bisect.bisect_left(addresses, end)]
        )

    return {name: [body(start) for start in targets] for name, targets in resolvers.items()}


@pytest.mark.parametrize("kernel", PROJECTOR + TURNED)
def test_each_hot_kernel_has_its_avx2_and_avx512_version(versions, kernel):
    assert kernel in versions, f"no versions of {kernel}"
    wide = re.compile(r"%zmm\d|%[xy]mm(1[6-9]|2\d|3[01])|%k[1-7]")
    assert any(wide.search(body) for body in versions[kernel]), "no AVX-512"
    assert any(re.search(r"%ymm\d", body) and not wide.search(body) for body in versions[kernel]), "no AVX2"
    assert any("%ymm" not in body and not wide.search(body) for body in versions[kernel]), "no baseline"


@pytest.mark.parametrize("kernel", PASSES + DESCENT)
def test_projector_and_descent_work_on_whole_vectors(versions, kernel):
    assert any(re.search(r"vfmadd\w+ps .*%ymm", body) for body in versions[kernel])
