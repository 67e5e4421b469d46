"""`palpate lesson new|check|start|export|score`: lessons that are written, taken as exams, and judged."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import doing, progress

MEANING = "Lessons with cases drawn by a seed: write, check, take as an exam, judge."
lesson_app = typer.Typer(
    no_args_is_help=True,
    help=f"Example: [bold]palpate lesson start lesson.yaml --seed 7 --record session.h5[/bold]\n\n{MEANING}",
)
LessonFile = Annotated[Path, typer.Argument(help="The lesson (.yaml).", show_default=False)]


def add(app: typer.Typer) -> None:
    """Adds the commands to `app`."""
    app.add_typer(lesson_app, name="lesson", short_help=MEANING)


@lesson_app.command("new", short_help="Writes a lesson to be changed by hand.")
def new_command(
    lesson: Annotated[Path, typer.Argument(help="The file to write (.yaml).", show_default=False)],
    organ: Annotated[Path, typer.Option(help="The tissue without lumps (.vtu).", show_default=False)],
) -> None:
    """Example: [bold]palpate lesson new lesson.yaml --organ tissue.vtu[/bold]

    Writes a lesson to be changed by hand. Lumps are drawn into the organ
    by a seed, so it is meshed without.
    """
    import os

    from palpate.atomic_write import replacing, writable

    writable(lesson)
    text = pp.lesson_template(os.path.relpath(organ, lesson.parent))
    with replacing(lesson) as temporary:
        temporary.write_text(text, encoding="utf-8")
    typer.echo(f"wrote {lesson}; change it, then: palpate lesson check {lesson}")


@lesson_app.command("check", short_help="Reads a lesson and draws some of its cases.")
def check_command(
    lesson: LessonFile,
    cases: Annotated[int, typer.Option(help="How many cases to draw, from seed 0 on.", min=1)] = 20,
) -> None:
    """Example: [bold]palpate lesson check lesson.yaml[/bold]

    Reads a lesson and draws some of its cases, so that one that cannot be
    taken is found before a class sits there. Prints where the lumps are,
    and how often a bot finds them that presses everywhere.
    """
    read = pp.read_lesson(lesson)
    organ = pp.read_tissue(read.organ)
    typer.echo(f"{read.title}: {read.asked}")
    typer.echo(f"trains {read.trains}\ncannot train {read.cannot}")
    with doing("pressing all over them"):
        ceiling = pp.lesson_ceiling(read, organ, cases)
    for seed in range(cases):
        case = pp.lesson_case(read, organ, seed)
        inside = case.mesh.region == case.mesh.region.max()
        middle = case.mesh.nodes[case.mesh.tets[inside]].mean(axis=(0, 1)).round(1).tolist()
        volume = float(case.mesh.volumes[inside].sum()) / 1000
        typer.echo(f"case {seed}: {volume:.2f} ml about {middle} mm, {case.young[inside].mean():.0f} kPa")
    low, high = ceiling.interval
    typer.echo(
        f"a bot that presses everywhere finds {ceiling.found} of {ceiling.sought} lumps ({low:.0%} to {high:.0%} of such "
        "cases): a hand is not expected to do better"
    )


@lesson_app.command("start", short_help="Opens a case as an exam.")
def start_command(
    lesson: LessonFile,
    seed: Annotated[int, typer.Option(help="Which case; the same seed is the same case.", show_default=False)],
    record: Annotated[Path | None, typer.Option(help="Write the session here when it ends (.h5).")] = None,
    channel: Annotated[
        str, typer.Option(help="How the force comes to the trainee: screen, sound, gamepad, device.")
    ] = "screen",
    device: Annotated[str | None, typer.Option(help="open-haptics, force-dimension or haply; see: doctor.")] = None,
    port: Annotated[int | None, typer.Option(help="On this machine's loopback. Default: a free one.")] = None,
    browser: Annotated[bool, typer.Option(help="Open the page here, or only print its address.")] = True,
) -> None:
    """Example: [bold]palpate lesson start lesson.yaml --seed 7 --record session.h5[/bold]

    Opens a case as an exam: the page shows and gets nothing that tells
    what is inside. Ctrl-C ends it.
    """
    read = pp.read_lesson(lesson)
    pp.take_lesson(read, seed, record=record, channel=channel, device=device, port=port, open_browser=browser)
    if record is not None:
        typer.echo(f"result: {shlex.join(['palpate', 'lesson', 'score', str(record), str(lesson)])}")


@lesson_app.command("export", short_help="Writes cases as pages that need no server.")
def export_command(
    lesson: LessonFile,
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="Page to write: .html; of several cases the folder.", show_default=False),
    ],
    seed: Annotated[int, typer.Option(help="Which case, or the first of several.", show_default=False)],
    cases: Annotated[int, typer.Option(help="How many cases, a page each.", min=1, max=1000)] = 1,
    channel: Annotated[
        str, typer.Option(help="How the force comes to the trainee: screen, sound, gamepad.")
    ] = "screen",
) -> None:
    """Example: [bold]palpate lesson export lesson.yaml --seed 1 --cases 20 -o class[/bold]

    Writes cases as pages that need no server: each works from a disk or
    any web host, offline. "Save session" in the page writes what was done
    there, for a result:
    palpate lesson score session.json lesson.yaml

    A page draws nothing of what is inside, but its file holds it, since
    its engine answers the hand. For an exam that counts: lesson start.
    """
    from palpate.atomic_write import new_folder, replacing_folder

    read = pp.read_lesson(lesson)
    if cases == 1:
        written = pp.export_case(read, seed, output, channel=channel)
        typer.echo(f"{written}: case {seed}, {written.stat().st_size / 1e6:.1f} MB; open it in a browser")
        return
    new_folder(output)
    with replacing_folder(output) as made, progress() as say:
        for number in range(cases):
            say(f"case {seed + number}", number / cases)
            pp.export_case(read, seed + number, made / f"case-{seed + number}.html", channel=channel)
        say(f"{cases} cases", 1.0)
    typer.echo(f"{output}: cases {seed} to {seed + cases - 1}, a page each")


@lesson_app.command("score", short_help="Judges a recorded session by its lesson.")
def score_command(
    session: Annotated[
        Path,
        typer.Argument(help="What `palpate lesson start` recorded (.h5), or a page saved (.json).", show_default=False),
    ],
    lesson: LessonFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="Report to write; .json and .csv beside it.")] = Path(
        "report.html"
    ),
) -> None:
    """Example: [bold]palpate lesson score session.h5 lesson.yaml -o report.html[/bold]

    Judges a recorded session by its lesson: draws the case again, replays
    the session, and says whether it has passed.
    """
    from palpate.atomic_write import writable

    writable(output)
    record, read = pp.read_record(session), pp.read_lesson(lesson)
    with progress() as say:
        result = pp.lesson_result(record, read, progress=lambda share: say(f"replaying {session.name}", share))
    words = ["palpate", "lesson", "score", str(session), str(lesson), "-o", str(output)]
    with doing("writing the report"):
        made = pp.score_report(output, result.score, None, command=shlex.join(words))
    typer.echo(result.text())
    typer.echo(f"report: {made[0].resolve()}")
