"""Options that give a region of a mesh a value of its own: `--region-young lump=20`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import typer

if TYPE_CHECKING:
    import palpate as pp

T = TypeVar("T", float, str)


def by_region(
    mesh: "pp.TetMesh",
    option: str,
    kind: Callable[[str], T],
    value: T | None,
    others: list[str] | None,
    named: list[str] | None = None,
) -> dict[int | str, T]:
    """`value` for each region, save those that `named` gives a tissue of their own; then those of `others`: "name=value"."""
    regions = sorted(set(mesh.region.tolist()))
    own = by_region(mesh, "--region-tissue", str, None, named) if named else {}
    values: dict[int | str, T] = {} if value is None else {r: value for r in regions if r not in own}
    numbers = {name: number for number, name in mesh.names.items()}
    for text in others or []:
        name, _, word = text.rpartition("=")
        try:
            region = numbers[name] if name in numbers else int(name)
            values[region] = kind(word)
        except ValueError:
            known = ", ".join(f"{r} ({mesh.names[r]})" if r in mesh.names else str(r) for r in regions)
            hint = f"give region=value; the mesh has regions {known}"
            raise typer.BadParameter(f"{text!r}: {hint}", param_hint=option) from None
    return values
