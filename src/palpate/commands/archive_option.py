"""`--on`: a command for each file of a folder or a list, spread over workers."""

import csv
import functools
import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

import palpate as pp
from palpate.commands.progress import progress

MORE = ("on", "suffix", "results", "report", "resume")  # options of which each run decides itself
FOR_ONE = ("error_map",)  # options that name a file to write, which all runs would
LISTS = (".csv", ".txt")


def archive_option(suffixes: Sequence[str], made: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Gives a command `--on`, `--suffix` and `--results`. Its first two parameters are what it reads and `output`.

    suffixes: of what is taken from a folder. made: suffix of an output, unless `--suffix` says another.
    """

    def extend(command: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(command)
        more = inspect.signature(archive_parameters).parameters.values()
        context = inspect.Parameter("ctx", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context)

        @functools.wraps(command)
        def extended(
            ctx: typer.Context, on: str | None, suffix: str | None, results: Path | None, **given: Any
        ) -> None:
            if on is None:
                if suffix is not None or results is not None:
                    raise pp.errors.DataError("suffix, results: they are for many files; give --on too, such as --on 2")
                command(**({"ctx": ctx} if "ctx" in own.parameters else {}), **given)
                return
            first = next(name for name in own.parameters if name != "ctx")
            run_each(ctx, given[first], given["output"], suffixes, suffix or made, on, results)

        parameters = [*[context] * ("ctx" not in own.parameters), *own.parameters.values(), *more]
        extended.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
        extended.__annotations__ = {p.name: p.annotation for p in parameters}
        return extended

    return extend


def archive_parameters(
    on: Annotated[
        str | None,
        typer.Option(
            help="For each file of a folder or a list (.csv, .txt): how many workers here, tcp://host:8786 or "
            "scheduler.json of Dask, or slurm:N.",
            show_default=False,
        ),
    ] = None,
    suffix: Annotated[str | None, typer.Option(help="For --on: of the outputs.", show_default=False)] = None,
    results: Annotated[
        Path | None,
        typer.Option(help="For --on: table (.csv, .parquet). Default: results.csv in -o.", show_default=False),
    ] = None,
) -> None:
    """What `archive_option` adds to a command's parameters."""


def run_each(
    ctx: typer.Context, source: Path, folder: Path, suffixes: Sequence[str], made: str, on: str, results: Path | None
) -> None:
    """Runs the command of `ctx` for each file of `source`, and writes the table. Ends with 1 if one failed."""
    from palpate.atomic_write import output_folder
    from palpate.cluster.archive import summary
    from palpate.cluster.connection import check_on
    from palpate.cluster.results_table import check_table

    check_on(on)
    words = words_of(ctx)
    plugins = tuple(path.resolve() for path in (ctx.parent.params.get("plugin") if ctx.parent else None) or ())
    runs = [
        pp.CommandRun(str(ctx.info_name), path, folder / name, (*words, *more), plugins)
        for path, name, more in entries(source, suffixes, made, ctx)
    ]
    output_folder(folder)
    table = check_table(results or folder / "results.csv")
    try:
        with progress() as say:
            records = pp.run_archive(runs, on, say)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("the same command goes on with what is not done yet") from None
    pp.write_results(table, runs, records)
    failed = [(run, record) for run, record in zip(runs, records, strict=True) if record.state == "failed"]
    for run, record in failed[:10]:
        typer.echo(f"failed: {run.input.name}: {record.reason}", err=True)
    if len(failed) > 10:
        typer.echo(f"and {len(failed) - 10} more: {table} says why", err=True)
    typer.echo(f"{folder}: {summary(records)}; {table}")
    if failed:
        raise typer.Exit(1)


def words_of(ctx: typer.Context) -> list[str]:
    """The options of a command line as words, files from the root; without what it reads, the output, and `MORE`."""
    words: list[str] = []
    for parameter in ctx.command.params:
        source = ctx.get_parameter_source(str(parameter.name))
        if parameter.param_type_name == "argument" or parameter.name in ("output", *MORE):
            continue
        if source is None or source.name != "COMMANDLINE":
            continue
        if parameter.name in FOR_ONE:
            raise pp.errors.DataError(f"{parameter.name}: not with --on, since all would write that file")
        words += option_words(parameter, ctx.params[str(parameter.name)])
    return words


def option_words(parameter: Any, value: Any) -> list[str]:
    """The words that give an option this value."""
    if isinstance(value, bool):
        return [parameter.opts[-1] if value else parameter.secondary_opts[-1]]
    values = value if isinstance(value, list | tuple) else [value]
    return [word for v in values for word in (parameter.opts[-1], word_of(v))]


def word_of(value: Any) -> str:
    """A value as a word; a file from the root, since a worker has another working directory."""
    from palpate.cluster.command_run import is_path

    text = str(getattr(value, "value", value))
    return str(Path(text).resolve()) if isinstance(value, Path) or is_path(text) else text


def entries(
    source: Path, suffixes: Sequence[str], made: str, ctx: typer.Context
) -> list[tuple[Path, str, tuple[str, ...]]]:
    """What is read, the name of the output, and more options, for each file of a folder or line of a list.

    Raises `FileError` and `DataError`.
    """
    from palpate.bounded_read import existing_path

    source = existing_path(source)
    if source.is_dir():
        found = sorted(path for path in source.iterdir() if path.name.endswith(tuple(suffixes)) and path.name[0] != ".")
        if not found:
            raise pp.errors.FileError(
                f"{source}: holds no {', '.join(suffixes)}; name the folder of the files, or a list"
            )
        return [(path, f"{stem(path, suffixes)}{made}", ()) for path in found]
    if source.suffix not in LISTS:
        raise pp.errors.DataError(f"{source}: with --on expected a folder, or a list (.csv, .txt), not one file")
    listed = lines_of(source, ctx)
    where = [(source.parent / line.pop("input"), line) for line in listed]
    return [
        (path, line.pop("output", "") or f"{stem(path, suffixes)}{made}", tuple(options(line, ctx)))
        for path, line in where
    ]


def lines_of(source: Path, ctx: typer.Context) -> list[dict[str, str]]:
    """The lines of a list. A .csv has columns input, output and options without their dashes; a .txt a path a line."""
    from palpate.bounded_read import read_text

    text = read_text(source)
    if source.suffix == ".txt":
        return [{"input": line.strip()} for line in text.splitlines() if line.strip() and line[0] != "#"]
    table = csv.DictReader(text.splitlines())
    known = {opt[2:] for p in ctx.command.params for opt in p.opts if opt.startswith("--") and p.name not in MORE}
    unknown = sorted(set(table.fieldnames or ()) - known - {"input", "output"})
    if "input" not in (table.fieldnames or ()) or unknown:
        missing = "input" not in (table.fieldnames or ())
        what = "no column input" if missing else f"unknown column {unknown[0]!r}"
        raise pp.errors.DataError(f"{source}: {what}; the columns are input, output, and options such as thickness")
    lines = []
    for number, line in enumerate(table, start=2):
        if not line["input"] or None in line or None in line.values():
            raise pp.errors.DataError(f"{source}: line {number}: expected {len(table.fieldnames or ())} values")
        lines.append({name: value.strip() for name, value in line.items()})
    return lines


def options(line: dict[str, str], ctx: typer.Context) -> list[str]:
    """The options that a line of a list gives; an empty value is none, and of a switch yes or no."""
    by_name = {opt[2:]: p for p in ctx.command.params for opt in p.opts if opt.startswith("--")}
    words: list[str] = []
    for name, value in line.items():
        parameter: Any = by_name[name]
        if value and parameter.is_flag:
            if value not in ("yes", "no"):
                raise pp.errors.DataError(f"{name}: {value!r}; expected yes or no")
            words += option_words(parameter, value == "yes") if value == "yes" or parameter.secondary_opts else []
        elif value:
            words += [parameter.opts[-1], word_of(value)]
    return words


def stem(path: Path, suffixes: Sequence[str]) -> str:
    """The name of a file without its suffix, of which .nii.gz is one."""
    known = [suffix for suffix in suffixes if path.name.endswith(suffix)]
    return path.name.removesuffix(max(known, key=len)) if known else path.stem
