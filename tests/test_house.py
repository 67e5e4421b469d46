"""The layout: imports go one way, down the chain of the data."""

import ast
import re
from pathlib import Path

import pytest

import palpate

CHAIN = ["volumes", "scans", "reconstruction", "meshes", "tissue", "simulation", "server", "studies", "commands"]
ANYWHERE = {"version", "errors", "arrays", "atomic", "samples", "_core"}
ROOT = Path(palpate.__file__).parent


def imported(path: Path) -> set[str]:
    """First part below palpate of each palpate module that a file imports, type-checking imports too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names = (
                [f"{node.module}.{alias.name}" for alias in node.names] if node.module == "palpate" else [node.module]
            )
        else:
            continue
        found |= {(name + ".").split(".")[1] for name in names if name and name.split(".")[0] == "palpate"}
    return found


def violations(path: Path) -> set[str]:
    home = path.relative_to(ROOT).parts[0].removesuffix(".py")
    if home in ("__init__", "__main__"):
        return set()
    allowed = ANYWHERE - {home} if home in ANYWHERE else ANYWHERE | set(CHAIN[: CHAIN.index(home) + 1])
    if home == "commands":
        allowed |= {""}
    return imported(path) - allowed


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_down_the_chain(path):
    assert not violations(path)


def test_an_upward_import_is_seen(tmp_path, monkeypatch):
    bad = tmp_path / "volumes" / "bad.py"
    bad.parent.mkdir()
    bad.write_text("from palpate.scans.scan import Scan\nimport palpate.server.app\n")
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    assert violations(bad) == {"scans", "server"}


def test_no_public_name_hides_a_folder():
    assert not {p.name for p in ROOT.iterdir() if p.is_dir()} & set(palpate.__all__)


def test_every_public_name_is_there():
    for name in palpate.__all__:
        assert getattr(palpate, name) is not None


def test_no_two_headers_of_the_core_give_a_type_one_name():
    """They share a namespace: the linker would take the code made for one, of its destructor say, for the other too."""
    found = {}
    for header in sorted((Path(__file__).parents[1] / "cpp").glob("*.h")):
        for name in re.findall(r"^(?:template <.*> )?(?:struct|class) (\w+)(?: : .*)? \{", header.read_text(), re.M):
            found.setdefault(name, []).append(header.name)
    assert len(found) > 100
    assert {name: headers for name, headers in found.items() if len(headers) > 1} == {}
