"""YAML of a size that people write: aliases cannot stand for more than that, and nothing is nested without end."""

from pathlib import Path
from typing import Any

import yaml

from palpate.bounded_read import NEST
from palpate.errors import FileError

NODES = 200_000  # with what aliases stand for; ten thousand views that are listed take half of it
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def yaml_in(path: Path, text: str, remedy: str) -> Any:
    """The value of a file's text. Raises `FileError`, with a remedy, if it is no YAML."""
    try:
        return parse_yaml(text)
    except (yaml.YAMLError, ValueError) as problem:
        raise FileError(f"{path}: not a YAML text ({' '.join(str(problem).split())}); {remedy}") from None


def parse_yaml(text: str) -> Any:
    """The value of a YAML text. Raises `yaml.YAMLError`, and `ValueError` if it is too large or nested too deep."""
    _check_nodes(text)
    return yaml.load(text, LOADER)  # a safe loader, whichever of the two


def _check_nodes(text: str) -> None:
    count = 0
    sizes: dict[str, int] = {}  # of what each anchor names
    under_way: list[
        tuple[str | None, int]
    ] = []  # anchors of the lists and maps that are open, and the nodes before them
    for event in yaml.parse(text, LOADER):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor in [one for one, _ in under_way]:
                raise ValueError(f"*{event.anchor} stands in what it stands for")
            count += sizes.get(str(event.anchor), 0)
        elif isinstance(event, yaml.NodeEvent):
            count += 1
            if isinstance(event, yaml.CollectionStartEvent):
                under_way.append((event.anchor, count - 1))
            elif event.anchor:
                sizes[event.anchor] = 1
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = under_way.pop()
            if anchor:
                sizes[anchor] = count - before
        if count > NODES or len(under_way) > NEST:
            raise ValueError(f"more than {NODES} values with what aliases stand for, or more than {NEST} in each other")
