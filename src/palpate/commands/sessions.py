"""`palpate sessions add|list|export|delete|report`: the scores of a class, without names."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import doing

MEANING = "Scores of many sessions: keep, compare, export, delete."
sessions_app = typer.Typer(
    no_args_is_help=True,
    help=f"Example: [bold]palpate sessions report class.db -o class.html[/bold]\n\n{MEANING}",
)
Store = Annotated[Path, typer.Argument(help="The store, an SQLite file.", show_default=False)]


def add(app: typer.Typer) -> None:
    """Adds the commands to `app`."""
    app.add_typer(sessions_app, name="sessions", short_help=MEANING)


@sessions_app.command("add", short_help="Scores a recorded session and keeps the score.")
def add_command(
    store: Annotated[Path, typer.Argument(help="The store; it is made if it is not there.", show_default=False)],
    session: Annotated[Path, typer.Argument(help="What `palpate touch --record` wrote (.h5).", show_default=False)],
    tissue: Annotated[Path, typer.Argument(help="The tissue that was touched (.vtu).", show_default=False)],
    person: Annotated[str, typer.Option(help="A code and no name: P07.", show_default=False)],
    group: Annotated[
        str, typer.Option(help="A word: novice. What the group `expert` does is compared with.")
    ] = "novice",
    channel: Annotated[
        str, typer.Option(help="How the force came to the trainee: screen, sound, gamepad, device.")
    ] = "screen",
    task: Annotated[str, typer.Option(help="What was asked: touch, lump or biopsy.")] = "touch",
    target: Annotated[str, typer.Option(help="Region that is sought. Default: the stiffest inside.")] = "",
    within: Annotated[float, typer.Option(help="How far beside a lump a mark may be, mm.")] = 5.0,
    force: Annotated[float, typer.Option(help="Force not to be exceeded, N.")] = 5.0,
    strain: Annotated[float, typer.Option(help="Stretch of the tissue not to be exceeded, as a share.")] = 0.3,
) -> None:
    """Example: [bold]palpate sessions add class.db session.h5 tissue.vtu --person P07 --task lump[/bold]

    Scores a recorded session and keeps the score, not the session.

    Of an expert, felt through a device:
    palpate sessions add class.db mine.h5 tissue.vtu --person X1 --group expert --channel device --task lump
    """
    from palpate.commands.score import scored
    from palpate.simulation.session_compatibility import tissue_hash

    solid, asked = pp.read_tissue(tissue), pp.Task(task, target, within, force, strain)
    score = scored(pp.read_record(session), solid, asked, session.name)
    row = pp.add_session(store, session, score, tissue_hash(solid), person, group, channel)
    typer.echo(score.text())
    typer.echo(f"{store}: {row.person} ({row.group}), attempt {row.attempt}")
    typer.echo(f"report: {shlex.join(['palpate', 'sessions', 'report', str(store), '-o', 'report.html'])}")


@sessions_app.command("list", short_help="Prints the sessions of a store.")
def list_command(store: Store) -> None:
    """Example: [bold]palpate sessions list class.db[/bold]"""
    rows = pp.read_sessions(store)
    line = "{:10}{:14}{:8}{:9}{:>8}{:>10}{:>10}{:>8}{:>8}".format
    typer.echo(line("person", "group", "task", "channel", "attempt", "time, s", "most, N", "found", "wrong"))
    for r in rows:
        scores = f"{r.seconds:.1f}", f"{r.max_force:.2f}", f"{r.found}/{r.sought}", r.wrong
        typer.echo(line(r.person, r.group, r.task, r.channel, r.attempt, *scores))
    typer.echo(f"{len(rows)} sessions of {len({r.person for r in rows})} people")


@sessions_app.command("export", short_help="Writes the sessions of a store as a table.")
def export_command(
    store: Store,
    output: Annotated[Path, typer.Option("-o", "--output", help="Table to write: .csv.", show_default=False)],
) -> None:
    """Example: [bold]palpate sessions export class.db -o class.csv[/bold]

    A row a session. The store remembers the table: when a person is deleted, it is written again.
    """
    typer.echo(f"wrote {output}: {pp.export_sessions(store, output)} sessions")


@sessions_app.command("delete", short_help="Deletes a person from a store and its tables.")
def delete_command(
    store: Store, person: Annotated[str, typer.Option(help="The person's code.", show_default=False)]
) -> None:
    """Example: [bold]palpate sessions delete class.db --person P07[/bold]

    Deletes all sessions of a person, in the store and in the tables that were
    exported from it. Reports and copies are yours to delete.
    """
    count, tables = pp.delete_person(store, person)
    typer.echo(f"{store}: {count} sessions of {person} deleted")
    for table in tables:
        typer.echo(f"written again without them: {table}")
    typer.echo("reports and copies that you made are not known to the store: delete them, too")


@sessions_app.command("report", short_help="Reports learning, groups and reliability.")
def report_command(
    store: Store,
    output: Annotated[Path, typer.Option("-o", "--output", help="Report to write.")] = Path("sessions.html"),
) -> None:
    """Example: [bold]palpate sessions report class.db -o class.html[/bold]

    Learning curves, novices against experts with effect size and interval,
    test-retest reliability, and each session among the experts.
    """
    words = ["palpate", "sessions", "report", str(store), "-o", str(output)]
    with doing("writing the report"):
        made = pp.session_report(output, store, command=shlex.join(words))
    typer.echo(f"report: {made.resolve()}")
