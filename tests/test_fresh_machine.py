"""What a fresh machine meets first: the named missing packages, the quick help, the doctor."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
COMMANDS = ("scan", "reconstruct", "view", "segment", "mesh", "fit", "scene", "cut", "touch", "demo", "study", "doctor")


def palpate(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "palpate", *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
    )


@pytest.mark.parametrize("lacking", ["g++", "git"])
def test_tools_names_what_is_missing_with_its_apt_line(tmp_path, lacking):
    for tool in {"sh", "uname", "g++", "git"} - {lacking}:
        if found := shutil.which(tool):
            (tmp_path / tool).symlink_to(found)
    (tmp_path / "python3").symlink_to(sys.executable)
    asked = subprocess.run(
        [shutil.which("sh"), ROOT / ".ci/tools"],
        capture_output=True,
        text=True,
        env={"PATH": str(tmp_path), "CXX": "g++"},
    )
    assert asked.returncode == 1
    assert f"sudo apt-get install -y {lacking}" in asked.stderr.replace("python3-venv ", "").replace("python3-dev ", "")


def test_tools_without_python_asks_for_python(tmp_path):
    asked = subprocess.run(
        [shutil.which("sh"), ROOT / ".ci/tools"], capture_output=True, text=True, env={"PATH": str(tmp_path)}
    )
    assert asked.returncode == 1
    assert "apt-get install -y python3 python3-venv python3-dev" in asked.stderr


def test_help_lists_every_command_in_the_order_of_the_data():
    shown = palpate("--help").stdout
    places = [shown.find(f" {name} ") for name in COMMANDS]
    assert -1 not in places
    assert places == sorted(places)


@pytest.mark.parametrize("command", COMMANDS)
def test_each_help_starts_with_an_example(command):
    asked = palpate(command, "--help")
    assert asked.returncode == 0
    assert f"palpate {command}" in asked.stdout.replace("python -m palpate", "")


def test_help_needs_no_numerical_library():
    code = (
        "import sys, palpate.commands; "
        "sys.exit(bool({'numpy', 'scipy', 'matplotlib', 'h5py', 'skfem', 'starlette'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0, "palpate --help would take over half a second"


def test_unknown_command_is_refused():
    asked = palpate("reconstrcut")
    assert asked.returncode == 2
    assert "No such command" in asked.stderr
