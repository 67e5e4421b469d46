"""docs/status.md names tests and commands that there are."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
STATUS = ROOT / "docs" / "status.md"


def test_every_test_that_status_names_exists():
    text = STATUS.read_text()
    named = re.findall(r"`(?:tests/)?(test_\w+)\.py::(\w+)`", text)
    assert len(named) > 40
    for module, name in named:
        tree = ast.parse((ROOT / "tests" / f"{module}.py").read_text())
        assert name in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}, f"{module}::{name}"
    assert text.count("::") == len(named), "a name that is not in the form `test_file.py::test_name`"
