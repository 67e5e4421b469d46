"""The benchmark of deformation: what judges ours and the peers. In a process of its own: it binds itself to cores."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

LAWS = """
import json, numpy as np
from benchmarks.cube_case import GREEN, STABLE
rng = np.random.default_rng(5)
F, lam, mu = np.eye(3) + 0.2 * rng.standard_normal((4, 3, 3)), rng.uniform(1, 3, 4), rng.uniform(1, 3, 4)
out = {}
for name, law in (("stable", STABLE), ("green", GREEN)):
    h, off = 1e-6, 0.0
    A = law.tangent(F, lam, mu)
    for k in range(3):
        for l in range(3):
            D = np.zeros((3, 3)); D[k, l] = h
            slope = (law.stress(F + D, lam, mu) - law.stress(F - D, lam, mu)) / (2 * h)
            off = max(off, np.abs(slope - A[..., k, l]).max() / np.abs(A).max())
    e = rng.standard_normal((3, 3)); e = (e + e.T) / 2
    small = law.stress(np.eye(3) + 1e-7 * e[None], lam[:1], mu[:1])[0] / 1e-7
    linear = 2 * mu[0] * e + lam[0] * np.trace(e) * np.eye(3)
    out[name] = [float(off), float(np.abs(small - linear).max() / np.abs(linear).max())]
print(json.dumps(out))
"""

SETTLE = """
import json, time, numpy as np
from benchmarks.settling_time import Run, settle
end = np.array([[0.0, 3.0, -4.0]])
def run(rate):
    state = {"k": 0}
    def step():
        state["k"] += 1
        time.sleep(0)
        sum(range(20000))
    return Run("made up", 0.0, step, lambda: end * (1 - rate ** state["k"]))
fast, known, slow = settle(run(0.5), 0.1), settle(run(0.5), 0.1, end), settle(run(0.9999), 0.02)
print(json.dumps([fast.steps, known.steps, slow.steps, bool(np.allclose(fast.end, end))]))
"""

APART = """
import json, sys, tempfile
from pathlib import Path
from benchmarks.peer_process import settled
sys.path.insert(0, tempfile.mkdtemp())
Path(sys.path[0], "made_up.py").write_text('''
import numpy as np
from benchmarks.settling_time import Run
def runs(cube):
    k = [0]
    def step():
        k[0] += 1
        sum(range(20000))
    yield Run("quick", 0.0, step, lambda: np.ones((1, 3)) * (1 - 0.5 ** k[0]))
    yield Run("endless", 0.0, lambda: [sum(range(1000)) for _ in iter(int, 1)], lambda: None)
''')
print(json.dumps([got if isinstance(got, str) else got.steps for got in settled("made_up", 3, 0.1, None, 3)]))
"""

TABLES = """
import json
import benchmarks.deformation as d
d.PEERS = ()  # they take minutes, and need not be installed
print(json.dumps(list(d.lines((5,)))))
"""


@pytest.fixture(scope="module")
def answered():
    def run(code):
        root = Path(__file__).parents[2]
        done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr[-2000:]
        return json.loads(done.stdout.strip().splitlines()[-1])

    return run


def test_the_peers_materials_are_consistent_and_linear_at_rest(answered):
    for slope, small in answered(LAWS).values():
        assert slope < 1e-8
        assert small < 1e-5


def test_steps_to_one_per_cent_are_counted_and_what_still_creeps_has_none(answered):
    # 0.5^k ≤ 0.01 first at k = 7
    assert answered(SETTLE) == [7, 7, None, True]


def test_a_peer_that_does_not_end_is_ended(answered):
    assert answered(APART) == [7, "not within 3 s of its process"]


def test_each_model_and_direct_solve_has_its_row(answered):
    lines = answered(TABLES)
    for name in ("`springs`", "`blocks`", "`multigrid`", "`neo-hookean`", "SuperLU", "`Factors`", "Vega"):
        assert any(name in line for line in lines)
    exact = next(line for line in lines if line.startswith("| our `Factors`"))
    assert exact.endswith("| 0.0000 % |")
