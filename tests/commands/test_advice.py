"""Advice works when it is typed: each command and option that the sources name, and what messages put together."""

import ast
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from support.running_server import HERE, ended
from typer.main import get_command

import palpate as pp
from palpate.commands import app

SOURCE = Path(pp.__file__).parent
GROUP = get_command(app)
COMMAND = re.compile(r"\bpalpate (?P<words>(?:scan |study )?[a-z]+)(?P<rest>(?:(?!, )[^;`\n\[\]])*)")


def strings():
    """Every string of the sources with its place; what is filled in later is X."""
    for path in sorted(SOURCE.rglob("*.py")):
        tree = ast.parse(path.read_text())
        inner = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                parts = [part.value if isinstance(part, ast.Constant) else "X" for part in node.values]
                yield f"{path.relative_to(SOURCE)}:{node.lineno}", "".join(map(str, parts))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inner:
                yield f"{path.relative_to(SOURCE)}:{node.lineno}", node.value


def command_of(words):
    """The command that these words begin with, its context, and the words after it; None if there is none."""
    command, context = GROUP, None
    while hasattr(command, "commands"):
        context = typer.Context(command, parent=context, info_name="palpate")
        if not words or words[0] not in command.commands:
            return None
        command, words = command.commands[words[0]], words[1:]
    return command, context, words


def options(command):
    return {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}


GROUPS = [name for name, command in GROUP.commands.items() if hasattr(command, "commands")]
EVERY = {"--help", "--plugin"} | {
    name
    for words in [[c] for c in GROUP.commands] + [[g, c] for g in GROUPS for c in GROUP.commands[g].commands]
    if (found := command_of(words))
    for name in options(found[0])
}
ADVISED = [
    (place, found["words"], found["rest"]) for place, text in strings() for found in COMMAND.finditer(text)
    if found["words"].split()[0] in GROUP.commands
]  # fmt: skip


def test_the_sources_advise_commands():
    assert len(ADVISED) > 60


def test_every_command_and_option_that_the_sources_name_exists():
    wrong = []
    for place, words, rest in ADVISED:
        found = command_of(words.split()) or command_of(words.split()[:1])
        named = re.findall(r"(?<![\w-])--?[a-z][a-z-]*", rest)
        if found and (unknown := set(named) - options(found[0]) - {"--help"}):
            wrong.append((place, words, unknown))
    assert wrong == []


def test_every_option_that_the_commands_packages_name_exists():
    """Without a command before it: `--port`, `--resume`. The studies start Chromium, whose options are others."""
    wrong = [
        (place, name)
        for place, text in strings()
        if not place.startswith("studies/realtime/browser")
        for name in re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)
        if name not in EVERY | {"--version"}
    ]
    assert wrong == []


def whole(text):
    """Reads an advised command to its last word, as typed in a shell."""
    (line,) = re.findall(r"palpate [a-z].*", text)
    command, context, words = command_of(shlex.split(line)[1:])
    return command.make_context("palpate", words, parent=context).params


def refusal(call, *arguments):
    with pytest.raises(pp.errors.PalpateError) as said:
        call(*arguments)
    return str(said.value)


@pytest.mark.parametrize("folder", ["plain", "with blank and 'quote'"])
def test_what_refusals_advise_is_read_whole(tmp_path, folder):
    from support.brick_meshes import brick

    path = tmp_path / folder
    assert shlex.split(refusal(pp.write_mesh, path / "mesh.vtu", brick((2, 2, 2))).split("make it first: ")[1]) == [
        "mkdir", "-p", str(path),
    ]  # fmt: skip
    path.mkdir()
    pp.write_mesh(path / "mesh.vtu", brick((2, 2, 2)))
    assert whole(refusal(pp.read_tissue, path / "mesh.vtu"))["mesh"] == path / "mesh.vtu"
    assert whole(refusal(pp.read_tissue, path / "tissue.msh"))["mesh"] == path / "tissue.msh"
    assert whole(refusal(pp.read_record, path / "session.h5"))["record"] == path / "session.h5"


def test_a_stopped_demo_is_gone_on_with_by_the_same_options(tmp_path, monkeypatch):
    def stopped(*given, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr(pp, "run_demo", stopped)
    from palpate.commands.demo import DemoName, demo

    with pytest.raises(KeyboardInterrupt) as said:
        demo(DemoName.breast, tmp_path / "my demo", browser=False, training=True, port=9999)
    asked = whole(str(said.value))
    assert asked["output"] == tmp_path / "my demo"
    assert (asked["training"], asked["browser"], asked["resume"], asked["port"]) == (True, False, True, 9999)


def test_version():
    assert ended("--version", Path.cwd()) == (0, f"palpate {pp.__version__}\n", "")


@pytest.mark.parametrize(("typed", "offered"), [("palpate rec", "reconstruct"), ("palpate fit --poi", "--poisson")])
def test_a_shell_completes_commands_and_options(typed, offered):
    words = {"_PALPATE_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1)}
    script = "import sys; sys.argv = ['palpate']; from palpate.commands import main; main()"  # as installed
    run = subprocess.run([sys.executable, "-c", script], env=HERE | words, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert offered in run.stdout.split()


def test_help_says_how_completion_is_installed():
    assert "--install-completion" in ended("--help", Path.cwd())[1]
