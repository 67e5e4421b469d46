"""The layout: imports and includes go one way, down the chain of the data, and never in a circle."""

import ast
import os
import re
from pathlib import Path

import pytest

import palpate

CHAIN = [
    "volumes",
    "scans",
    "reconstruction",
    "meshes",
    "tissue",
    "differentiable",
    "simulation",
    "haptics",
    "report",
    "server",
    "standalone",
    "rooms",
    "display",
    "napari_plugin",
    "cluster",
    "studies",
    "demos",
    "commands",
]
ANYWHERE = {"version", "errors", "arrays", "interrupts", "atomic_write", "bounded_read", "plugins", "samples", "_core"}
ROOT = Path(palpate.__file__).parent
REPOSITORY = Path(__file__).parents[1]
CPP = REPOSITORY / "cpp"
WEB = REPOSITORY / "web" / "src"
WEB_FOLDERS = [
    "protocol",
    "engine",
    "organ",
    "rendering",
    "tools",
    "endoscopy",
    "input",
    "ui",
    "sound",
    "slices",
    "touch",
    "notebook",
]


def imported(path: Path) -> set[str]:
    """Every dotted name below palpate that a file imports, type-checking imports too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name.removeprefix("palpate.") for name in found if name.startswith("palpate.")}


def violations(path: Path, root: Path = ROOT) -> set[str]:
    """The packages that a file imports and that do not lie below its own."""
    home = path.relative_to(root).parts[0].removesuffix(".py")
    if home in ("__init__", "__main__"):
        return set()
    allowed = ANYWHERE - {home} if home in ANYWHERE else ANYWHERE | set(CHAIN[: CHAIN.index(home) + 1])
    return {name.split(".")[0] for name in imported(path)} - allowed


def cycle(edges: dict[str, set[str]]) -> list[str]:
    """Some circle of a directed graph, empty if there is none."""
    done: set[str] = set()

    def visit(node: str, way: list[str]) -> list[str]:
        if node in way:
            return [*way[way.index(node) :], node]
        if node in done:
            return []
        found = next((c for to in sorted(edges.get(node, ())) if (c := visit(to, [*way, node]))), [])
        done.add(node)
        return found

    return next((c for node in sorted(edges) if (c := visit(node, []))), [])


def module_edges(root: Path) -> dict[str, set[str]]:
    """Module -> the modules of the package that it imports, imports inside functions too."""
    files = {".".join(p.relative_to(root).with_suffix("").parts): p for p in root.rglob("*.py")}
    files = {name: path for name, path in files.items() if not name.endswith("__init__")}
    edges = {}
    for name, path in files.items():
        found = imported(path)
        edges[name] = {module for module in files if module in found or any(i.startswith(f"{module}.") for i in found)}
    return edges


def include_edges(root: Path) -> dict[str, set[str]]:
    """File of the core -> the files of the core that it includes."""
    files = [p for p in root.rglob("*") if p.suffix in (".h", ".cpp")]
    return {p.relative_to(root).as_posix(): set(re.findall(r'^#include "([^"]+)"', p.read_text(), re.M)) for p in files}


def kernel_folders() -> dict[str, set[str]]:
    """Folder of the core -> those that it may include, as CMakeLists.txt links them."""
    lines = re.findall(r"^kernel_folder\((\w+)((?: \w+)*)\)", (REPOSITORY / "CMakeLists.txt").read_text(), re.M)
    return {name: set(below.split()) for name, below in lines}


def web_edges(root: Path) -> dict[str, set[str]]:
    """File of the page -> the files of the page that it imports; types too."""
    edges = {}
    for path in root.rglob("*.ts"):
        found = re.findall(r'(?:from|import\(?) ?"(\.[^"]+?)(?:\.ts)?"', path.read_text())
        edges[path.relative_to(root).as_posix()] = {
            Path(os.path.normpath(path.parent / name)).relative_to(root).as_posix() + ".ts" for name in found
        }
    return edges


def upward_web_imports(edges: dict[str, set[str]]) -> set[tuple[str, str]]:
    """Imports from a folder that comes after the importing one. worker.ts, the only file outside, is above `organ`."""
    order = {folder: level for level, folder in enumerate(WEB_FOLDERS)} | {"worker.ts": 2}
    return {
        (file, to)
        for file, found in edges.items()
        for to in found
        if order[to.split("/")[0]] > order[file.split("/")[0]]
    }


def upward_includes(edges: dict[str, set[str]]) -> set[tuple[str, str]]:
    """Includes of a folder that the including folder does not list."""
    below = kernel_folders()
    return {
        (file, header)
        for file, headers in edges.items()
        for header in headers
        if (home := file.split("/")[0]) in below and header.split("/")[0] not in below[home] | {home}
    }


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_go_down_the_chain(path):
    assert not violations(path)


def test_no_module_imports_itself_in_a_circle():
    edges = module_edges(ROOT)
    assert sum(map(len, edges.values())) > 500
    assert cycle(edges) == []


def test_includes_of_the_core_go_down():
    edges = include_edges(CPP)
    assert set(kernel_folders()) == {p.name for p in CPP.iterdir() if p.is_dir()} - {"bindings", "wasm"}
    listed = list(kernel_folders().items())
    assert all(below <= {name for name, _ in listed[:k]} for k, (_, below) in enumerate(listed))
    assert upward_includes(edges) == set()
    assert cycle(edges) == []


def test_imports_of_the_page_go_down():
    edges = web_edges(WEB)
    assert {file.split("/")[0] for file in edges} == {*WEB_FOLDERS, "worker.ts"}
    assert sum(map(len, edges.values())) > 100
    assert set().union(*edges.values()) <= set(edges)
    assert upward_web_imports(edges) == set()
    assert cycle(edges) == []
    assert edges["protocol/server-messages.ts"] == set()


def test_upward_imports_of_the_page_and_circles_are_seen(tmp_path):
    for name, text in {
        "organ/a.ts": 'import type { B } from "../touch/b";\n',
        "touch/b.ts": 'import { A } from "../organ/a";\nconst later = () => import("./c");\n',
        "touch/c.ts": "",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    edges = web_edges(tmp_path)
    assert edges["touch/b.ts"] == {"organ/a.ts", "touch/c.ts"}
    assert upward_web_imports(edges) == {("organ/a.ts", "touch/b.ts")}
    assert set(cycle(edges)) == {"organ/a.ts", "touch/b.ts"}


def test_upward_imports_and_circles_are_seen(tmp_path):
    """A planted one turns each of the checks red."""
    bad, other = tmp_path / "volumes" / "bad.py", tmp_path / "scans" / "scan.py"
    bad.parent.mkdir(), other.parent.mkdir()
    bad.write_text("from palpate.scans.scan import Scan\nimport palpate.server.app\n")
    other.write_text("def later():\n    from palpate.volumes import bad\n")
    assert violations(bad, tmp_path) == {"scans", "server"}
    assert set(cycle(module_edges(tmp_path))) == {"volumes.bad", "scans.scan"}
    (tmp_path / "base").mkdir()
    (tmp_path / "base" / "a.h").write_text('#pragma once\n#include "tissue/b.h"\n')
    (tmp_path / "tissue").mkdir()
    (tmp_path / "tissue" / "b.h").write_text('#pragma once\n#include "base/a.h"\n')
    edges = include_edges(tmp_path)
    assert upward_includes(edges) == {("base/a.h", "tissue/b.h")}
    assert set(cycle(edges)) == {"base/a.h", "tissue/b.h"}


def test_no_public_name_hides_a_folder():
    assert not {p.name for p in ROOT.iterdir() if p.is_dir()} & set(palpate.__all__)


def test_every_public_name_is_there():
    for name in palpate.__all__:
        assert getattr(palpate, name) is not None


def test_no_two_headers_of_the_core_give_a_type_one_name():
    """They share a namespace: the linker would take the code made for one, of its destructor say, for the other too."""
    found = {}
    for header in sorted(CPP.rglob("*.h")):
        for name in re.findall(r"^(?:template <.*> )?(?:struct|class) (\w+)(?: : .*)? \{", header.read_text(), re.M):
            found.setdefault(name, []).append(header.name)
    assert len(found) > 100
    assert {name: headers for name, headers in found.items() if len(headers) > 1} == {}
