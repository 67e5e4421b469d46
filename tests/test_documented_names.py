"""Every public name is documented: in the reference, with its sections, and with examples that run."""

import doctest
import importlib
import inspect
import re
from pathlib import Path

import pytest

import palpate as pp
from palpate import plugins

REFERENCE = (Path(__file__).parents[1] / "docs" / "reference" / "index.md").read_text()
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
NOT_RUN = {
    "deformation_study",
    "detection_study",
    "doubt_study",
    "head_study",
    "realtime_study",
    "tomosynthesis_study",
}  # minutes each
RAISE_NOTHING = {
    "slab_phantom",
    "breast_phantom",
    "find_devices",
    "include",
    "lesson_template",
    "plot_indentation",
    "fixed_at_openings",
}


def sections(documented):
    return set(re.findall(r"^(\w+)\n-{3,}$", inspect.getdoc(documented) or "", re.MULTILINE))


def described(documented):
    """Parameters and attributes that the docstring describes."""
    text = inspect.getdoc(documented) or ""
    return {
        name.strip("* ") for line in re.findall(r"^([*\w, ]+)(?: : |$)", text, re.MULTILINE) for name in line.split(",")
    }


def parameters(function):
    return {name for name in inspect.signature(function).parameters if name not in ("self", "cls")}


def check(function, name, where=""):
    """Asserts the sections of a function that its signature asks for."""
    found = sections(function)
    asked = parameters(function)
    assert asked <= described(function), f"{where}{name}: not described: {asked - described(function)}"
    if inspect.signature(function).return_annotation not in (None, "None"):
        assert found & {"Returns", "Yields"}, f"{where}{name}: Returns"
    return found


def test_the_reference_lists_every_name_once():
    listed = re.findall(r"^   (\w+)$", REFERENCE, re.MULTILINE)
    assert sorted(listed) == pp.__all__


@pytest.mark.parametrize("name", pp.__all__)
def test_every_public_name_has_its_sections(name):
    documented = getattr(pp, name)
    if not inspect.isclass(documented):
        found = check(documented, name)
        assert "Examples" in found
        assert "Raises" in found or name in RAISE_NOTHING
        return
    assert {"Examples"} <= sections(documented)
    asked = parameters(documented)
    assert asked <= described(documented), f"{name}: not described: {asked - described(documented)}"
    for member, value in vars(documented).items():
        function = getattr(value, "__func__", value)
        if not member.startswith("_") and inspect.isfunction(function):
            check(function, member, f"{name}.")


@pytest.fixture(scope="module")
def example_names():
    (code,) = re.findall(r"^```python\n(.*?)^```", REFERENCE, re.MULTILINE | re.DOTALL)
    names = {"Path": Path, "pytest": pytest}
    exec(code, names)
    return names


@pytest.mark.parametrize("name", pp.__all__)
def test_the_examples_run(name, example_names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plugins, "_registered", {kind: dict(parts) for kind, parts in plugins._registered.items()})
    documented = getattr(pp, name)
    module = importlib.import_module(documented.__module__)
    finder = doctest.DocTestFinder(recurse=inspect.isclass(documented))
    runner = doctest.DocTestRunner(optionflags=OPTIONS)
    said = []
    for example in finder.find(documented, name, module=module, globs=dict(example_names)):
        runner.run(example, out=said.append)
    assert runner.failures == 0, "".join(said)
    assert runner.tries > 0 or name in NOT_RUN
