"""`palpate ask`."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import doing


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("ask", short_help="Asks a person two alternatives, and fits the threshold.")(ask_command)


def ask_command(
    tissue: Annotated[Path, typer.Argument(help="What `palpate fit` wrote (.vtu).", show_default=False)],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Answers, a line each (.jsonl); .csv and .svg beside it.")
    ] = Path("answers.jsonl"),
    question: Annotated[str, typer.Option(help="stiffness: which is stiffer; lump: which holds it.")] = "stiffness",
    procedure: Annotated[str, typer.Option(help="How levels are chosen: quest or staircase.")] = "quest",
    trials: Annotated[int, typer.Option(help="How many; a staircase may end before.")] = 60,
    levels: Annotated[
        str | None,
        typer.Option(help="Relative differences of stiffness: 0.05,0.1,0.2,0.4. Default: 31 from 0.02 to 2."),
    ] = None,
    diameter: Annotated[float, typer.Option(help="Of the lump, mm.")] = 15.0,
    seed: Annotated[int, typer.Option(help="Of the orders, and of the lump's place.")] = 0,
    channel: Annotated[
        str, typer.Option(help="How the force comes to the person: screen, sound, gamepad, device.")
    ] = "screen",
    feedback: Annotated[bool, typer.Option("--feedback", help="Tell after each answer whether it was right.")] = False,
    pause: Annotated[int, typer.Option(help="Trials after which a break is offered. 0: none.")] = 20,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the answers that are there.")] = False,
    device: Annotated[str | None, typer.Option(help="open-haptics, force-dimension or haply; see: doctor.")] = None,
    port: Annotated[int | None, typer.Option(help="On this machine's loopback. Default: a free one.")] = None,
    browser: Annotated[bool, typer.Option(help="Open the page here, or only print its address.")] = True,
) -> None:
    """Example: [bold]palpate ask tissue.vtu --question stiffness -o answers.jsonl[/bold]

    Asks a person which of two organs is stiffer, or holds a lump, until
    the threshold is known. Each trial has two intervals, to be palpated
    in turn. Each answer is on the disk at once; the same command with
    --resume goes on. The threshold, a table and a picture come at the end.
    """
    from palpate.atomic_write import replacing, writable
    from palpate.report.tables import write_table
    from palpate.simulation.answer_fit import threshold_text

    table, picture = output.with_suffix(".csv"), output.with_suffix(".svg")
    for path in (table, picture):
        writable(path)
    shown = pp.ForcedChoice().levels if levels is None else _levels(levels)
    experiment = pp.ForcedChoice(question, procedure, trials, shown, seed, channel, feedback, diameter, pause)
    organ = pp.read_tissue(tissue)
    answers = pp.ask(
        organ,
        output,
        experiment,
        resume=resume,
        device=device,
        port=port,
        open_browser=browser,
        title=tissue.stem,
    )
    done = len(answers.trials)
    if answers.next_level is not None:
        typer.echo(f"{done} of {trials} trials answered; the same command with --resume goes on")
    if not done:
        return
    found = pp.fit_answers(answers.trials, experiment)
    with doing("asking the ideal observer"):
        ideal = pp.ideal_observer(experiment, organ)
    typer.echo(f"{question} by {channel}, {done} answers: {threshold_text(found)}")
    typer.echo(f"ideal observer, which presses by 2 mm and reads the screen: {threshold_text(ideal)}")
    rows = [
        {
            "trial": one.trial, "question": one.question, "level": one.level, "order": one.order, "answer": one.answer,
            "right": int(one.right), "seconds": one.seconds, "channel": one.channel,
            "force_1_N": one.force[0], "force_2_N": one.force[1],
        }
        for one in answers.trials
    ]  # fmt: skip
    write_table(table, rows)
    with replacing(picture) as temporary:
        pp.plot_answers(answers.trials, found, ideal, f"{question} by {channel}").savefig(temporary, format="svg")
    typer.echo(f"wrote {shlex.quote(str(table))}, {shlex.quote(str(picture))}")


def _levels(text: str) -> tuple[float, ...]:
    """Numbers from x,y,..."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r}: give numbers, such as 0.05,0.1,0.2", param_hint="--levels") from None
