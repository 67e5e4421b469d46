"""The command `palpate`: each command reads files, calls one public function, writes files."""

import sys
from importlib import import_module

import typer

from palpate.errors import PalpateError

app = typer.Typer(
    name="palpate",
    help="From a handful of X-ray projections to an organ you can touch. Research software, not a medical device.",
    epilog="Start with: palpate demo",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)

# In the order of the data. A module adds its commands to the app it is given.
for _name in ("scan", "reconstruct", "segment", "mesh", "fit", "touch", "demo", "doctor"):
    import_module(f"palpate.commands.{_name}").add(app)


def main() -> None:
    """Runs the command line; what palpate refuses is one clear line, not a traceback."""
    try:
        app()
    except PalpateError as refusal:
        print(f"palpate: {refusal}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("\npalpate: stopped", file=sys.stderr)
        sys.exit(130)
