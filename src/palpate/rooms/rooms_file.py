"""Rooms: what each holds, and the YAML file that lists several."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.bounded_read import read_text
from palpate.errors import DataError, PalpateError
from palpate.scans.bounded_yaml import yaml_in

KIND, VERSION = "palpate rooms", 1
MOST_ROOMS = 64
KEYS = ("organs", "title", "model", "radius", "tension", "toughness", "record", "replay", "lesson", "seed")
MOST_REPLAYS = 2


@dataclass(frozen=True)
class RoomFile:
    """A room: its name in invitations, and what is touched in it.

    Parameters
    ----------
    name : str
        Of the room: letters, digits, - and _.
    organs : tuple of Path
        Tissues (.vtu): resolutions of one organ; the first is shown. None with a lesson, which names its own.
    title : str, optional
        Title of the page. The default is the name; with a lesson it is the lesson's.
    model : str, optional
        A name that `pp.model` knows. The default is what keeps 1000 ticks a second.
    radius : float, optional
        Of the contact, mm. The default is two edge lengths.
    tension : float, optional
        Of the tissue at rest, kPa.
    toughness : float or dict, optional
        Energy that a cut takes for each area, J/m²: of the first organ, or by the names of its regions. The default is that
        of the named tissues.
    record : Path, optional
        File for the session (.h5).
    replay : tuple of Path, optional
        One or two recorded sessions that everybody watches, side by side, in place of an organ that is touched. Teachers
        play them. Each needs its tissue among the organs.
    lesson : Path, optional
        A lesson (.yaml), one case of which all who are in the room take together, as an exam.
    seed : int, optional
        Which case.

    Raises
    ------
    DataError
        If a value is not what it may be.

    Examples
    --------
    >>> pp.RoomFile("anatomy", (Path("kidney.vtu"),)).title
    'anatomy'
    """

    name: str
    organs: tuple[Path, ...]
    title: str = ""
    model: str | None = None
    radius: float | None = None
    tension: float = 0.0
    record: Path | None = None
    replay: tuple[Path, ...] = ()
    toughness: float | Mapping[str, float] | None = None
    lesson: Path | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.name or len(self.name) > 40 or not self.name.replace("-", "").replace("_", "").isalnum():
            raise DataError(f"room: {self.name[:60]!r}; expected a name of letters, digits, - and _, at most 40")
        if self.lesson:
            others = ("organs", "title", "replay", "model", "radius", "tension", "toughness")
            if given := [key for key in others if getattr(self, key)]:
                raise DataError(
                    f"room {self.name}: lesson: it says what is touched and how; leave out {', '.join(given)}"
                )
        elif not self.organs:
            raise DataError(f"room {self.name}: organs: none; name a tissue (.vtu)")
        if len(self.replay) > MOST_REPLAYS:
            raise DataError(
                f"room {self.name}: replay: {len(self.replay)} sessions; up to {MOST_REPLAYS} stand side by side"
            )
        if self.replay and (self.record or self.model or self.radius):
            raise DataError(
                f"room {self.name}: replay: model, radius and record are those of what is replayed; leave them out"
            )
        if not self.title:
            object.__setattr__(self, "title", self.name)


def read_rooms(path: str | Path) -> tuple[RoomFile, ...]:
    """Read a list of rooms.

    .. code-block:: yaml

        palpate rooms: 1
        rooms:
          anatomy: {organs: [kidney.vtu], record: anatomy.h5}
          abdomen: {organs: [abdomen.vtu], title: An abdomen, tension: 2}
          lecture: {organs: [kidney.vtu], replay: [novice.h5, expert.h5]}
          exam: {lesson: lesson.yaml, seed: 7, record: exam.h5}

    Of each room what `RoomFile` takes. Files are relative to the list's.

    Parameters
    ----------
    path : str or Path
        A YAML file.

    Returns
    -------
    tuple of RoomFile
        The rooms in their order.

    Raises
    ------
    FileError
        If the file is missing or no YAML.
    DataError
        If a key is unknown or missing, or a value is not what it may be.

    Examples
    --------
    >>> _ = Path("rooms.yaml").write_text("palpate rooms: 1\\nrooms: {anatomy: {organs: [kidney.vtu]}}")
    >>> pp.read_rooms("rooms.yaml")[0].name
    'anatomy'
    """
    path = Path(path)
    content = yaml_in(path, read_text(path), "write it as pp.read_rooms says")
    try:
        if not isinstance(content, dict) or content.get(KIND) != VERSION or set(content) != {KIND, "rooms"}:
            raise DataError(f"expected `{KIND}: {VERSION}` and `rooms:` in it; write it as pp.read_rooms says")
        rooms = content["rooms"]
        if not isinstance(rooms, dict) or not 0 < len(rooms) <= MOST_ROOMS:
            raise DataError(f"rooms: expected one to {MOST_ROOMS} names with what is in each")
        found = tuple(_room(path.parent, str(name), given) for name, given in rooms.items())
        records = [room.record.resolve() for room in found if room.record is not None]
        if len(set(records)) < len(records):
            raise DataError("record: two rooms write the same file; give each its own")
        return found
    except PalpateError as problem:
        raise type(problem)(f"{path}: {problem}") from None


def _room(folder: Path, name: str, given: Any) -> RoomFile:
    if not isinstance(given, dict):
        raise DataError(f"room {name}: expected {{organs: [kidney.vtu]}} or the like, got {str(given)[:40]!r}")
    if unknown := sorted(set(map(str, given)) - set(KEYS)):
        raise DataError(f"room {name}: {unknown[0]}: no such key; there are {', '.join(KEYS)}")
    organs: tuple[str, ...] = ()
    if "organs" in given or "lesson" not in given:
        organs = _files(name, "organs", given, "names of tissues: [kidney.vtu]")
    replay = _files(name, "replay", given, "recorded sessions: [session.h5]") if "replay" in given else ()
    for key in ("title", "model", "record", "lesson"):
        if not isinstance(given.get(key, ""), str):
            raise DataError(f"room {name}: {key}: expected a text, got {str(given[key])[:40]!r}")
    tough = given.get("toughness", 0.0)
    by_region = tough if isinstance(tough, dict) else {}
    if not all(isinstance(region, str) for region in by_region):
        raise DataError(f"room {name}: toughness: expected names of regions, such as lump: 900")
    single = {} if by_region else {"toughness": tough}
    numbers = {"radius": given.get("radius", 0.0), "tension": given.get("tension", 0.0), **single}
    for key, value in (*numbers.items(), *((f"toughness: {region}", tough) for region, tough in by_region.items())):
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 1e4:
            raise DataError(f"room {name}: {key}: {str(value)[:40]!r}; expected a number from 0 on")
    seed = given.get("seed", 0)
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0 or ("seed" in given and "lesson" not in given):
        raise DataError(f"room {name}: seed: {str(seed)[:40]!r}; with a lesson, a whole number from 0 on")
    record, lesson = (folder / given[key] if given.get(key) else None for key in ("record", "lesson"))
    plain = {key: given[key] for key in ("title", "model", "radius", "tension", "toughness", "seed") if key in given}
    paths = [tuple(folder / one for one in files) for files in (organs, replay)]
    return RoomFile(name, paths[0], record=record, replay=paths[1], lesson=lesson, **plain)


def _files(name: str, key: str, given: dict[Any, Any], expected: str) -> tuple[str, ...]:
    """The file names of a key: one, or a list of them."""
    files = given.get(key)
    files = [files] if isinstance(files, str) else files
    if not isinstance(files, list) or not files or not all(isinstance(one, str) for one in files):
        raise DataError(f"room {name}: {key}: expected {expected}")
    return tuple(files)
