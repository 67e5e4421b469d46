"""The command `palpate`: each command reads files, calls one public function, writes files."""

import sys
import warnings
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperGroup

from palpate import interrupts
from palpate.commands.option_names import OptionCommand, option_names
from palpate.errors import PalpateError
from palpate.plugins import load
from palpate.version import __version__

# In the order of the data. A module adds its commands to the app it is given.
COMMANDS = (
    "scan",
    "reconstruct",
    "view",
    "segment",
    "mesh",
    "fit",
    "scene",
    "cut",
    "indent",
    "touch",
    "serve",
    "join",
    "export",
    "score",
    "lesson",
    "ask",
    "sessions",
    "demo",
    "study",
    "doctor",
)

LONGEST = 1600  # characters of a message


class DataOrderGroup(TyperGroup):
    """The commands in the order of the data, and Ctrl-C that says what it left."""

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
        """The names in the order in which help shows them."""
        return list(COMMANDS)

    def invoke(self, ctx: typer.Context) -> object:  # type: ignore[override]
        """Runs a command. A command says how to go on by the text of the KeyboardInterrupt that it lets out."""
        try:
            with interrupts.raised() as was_raised:
                try:
                    return super().invoke(ctx)
                except (PalpateError, OSError, typer.Exit):
                    raise
                except Exception:
                    if was_raised():  # pybind11 makes a TypeError of it where it converts arguments
                        raise KeyboardInterrupt from None
                    raise
        except KeyboardInterrupt as stop:
            typer.echo(f"palpate: stopped{'; ' if str(stop) else ''}{stop}", err=True)
            raise typer.Exit(interrupts.STOPPED) from None


app = typer.Typer(
    cls=DataOrderGroup,
    name="palpate",
    help="From a handful of X-ray projections to an organ you can touch. Research software, not a medical device.",
    epilog="Start with: palpate demo",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)


def show_version(wanted: bool) -> None:
    """Prints the version and ends."""
    if wanted:
        typer.echo(f"palpate {__version__}")
        raise typer.Exit


@app.callback()
def plugins(
    plugin: Annotated[
        list[Path] | None,
        typer.Option(envvar="PALPATE_PLUGINS", help="Python file that registers parts of your own; may be repeated."),
    ] = None,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=show_version, is_eager=True)
    ] = False,
) -> None:
    """Loads plugins before the command looks for their parts."""
    for path in plugin or ():
        load(path)


for _name in COMMANDS:
    import_module(f"palpate.commands.{_name}").add(app)
for _app in (app, *(group.typer_instance for group in app.registered_groups)):
    for _command in _app.registered_commands if _app else ():
        _command.cls = OptionCommand


def main() -> None:
    """Runs the command line; what palpate refuses, or the machine lacks, is one clear line, not a traceback."""
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _note
            app()
    except PalpateError as refusal:
        print(f"palpate: {_line(str(refusal))}", file=sys.stderr)
        sys.exit(2)
    except MemoryError as lack:
        print(f"palpate: not enough memory ({lack or 'no more'}); take coarser voxels or elements", file=sys.stderr)
        sys.exit(1)
    except RuntimeError as problem:
        if "can't start new thread" not in str(problem):
            raise
        print(
            "palpate: the system gives no more threads; end other programs, or raise the limit: ulimit -u",
            file=sys.stderr,
        )
        sys.exit(1)
    except OSError as problem:  # a full disk, above all
        print(f"palpate: {problem}", file=sys.stderr)
        sys.exit(1)


def _line(text: str) -> str:
    """A message as one line: what it quotes from a file may be of any length."""
    line = " ".join(text.splitlines())
    return line if len(line) <= LONGEST else f"{line[: LONGEST // 2]} ... {line[-LONGEST // 4 :]}"


def _note(message: Warning | str, category: type[Warning], *where: object, **more: object) -> None:
    """What a library function warns of, as a line for people."""
    print(f"note: {_line(option_names(str(message)))}", file=sys.stderr)
