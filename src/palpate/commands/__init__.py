"""The command `palpate`: each command reads files, calls one public function, writes files."""

import sys
import warnings
from importlib import import_module

import typer
from typer.core import TyperGroup

from palpate.errors import PalpateError

# In the order of the data. A module adds its commands to the app it is given.
COMMANDS = ("scan", "reconstruct", "view", "segment", "mesh", "fit", "touch", "score", "demo", "study", "doctor")
STOPPED = 130  # what a shell expects of a program that Ctrl-C ended


class InOrder(TyperGroup):
    """The commands in the order of the data, and Ctrl-C that says what it left."""

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
        """The names in the order in which help shows them."""
        return list(COMMANDS)

    def invoke(self, ctx: typer.Context) -> object:  # type: ignore[override]
        """Runs a command. A command says how to go on by the text of the KeyboardInterrupt that it lets out."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            typer.echo(f"palpate: stopped{'; ' if str(stop) else ''}{stop}", err=True)
            raise typer.Exit(STOPPED) from None


app = typer.Typer(
    cls=InOrder,
    name="palpate",
    help="From a handful of X-ray projections to an organ you can touch. Research software, not a medical device.",
    epilog="Start with: palpate demo",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)

for _name in COMMANDS:
    import_module(f"palpate.commands.{_name}").add(app)


def main() -> None:
    """Runs the command line; what palpate refuses, or the machine lacks, is one clear line, not a traceback."""
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _note
            app()
    except PalpateError as refusal:
        print(f"palpate: {refusal}", file=sys.stderr)
        sys.exit(2)
    except MemoryError as lack:
        print(f"palpate: not enough memory ({lack or 'no more'}); take coarser voxels or elements", file=sys.stderr)
        sys.exit(1)
    except OSError as problem:  # a full disk, above all
        print(f"palpate: {problem}", file=sys.stderr)
        sys.exit(1)


def _note(message: Warning | str, category: type[Warning], *where: object, **more: object) -> None:
    """What a library function warns of, as a line for people."""
    print(f"note: {message}", file=sys.stderr)
