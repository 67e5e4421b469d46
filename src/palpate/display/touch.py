"""Opens the simulator: as a widget in a notebook, else from a server on the loopback interface."""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.atomic_write import writable
from palpate.display.notebook import in_notebook, require_extra
from palpate.errors import DataError, MaterialError
from palpate.haptics.discovery import open_device
from palpate.server.access_control import check_page
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import replayed, serve_until_closed, speed_warning
from palpate.server.view import image_payloads
from palpate.simulation.pointer import Pointer
from palpate.simulation.recording import Record
from palpate.simulation.session import Session
from palpate.simulation.starting_model import starting_model
from palpate.tissue.io import write_tissue
from palpate.tissue.models.registry import model as build
from palpate.tissue.tissue import Tissue
from palpate.volumes.volume import Volume

if TYPE_CHECKING:
    from palpate.display.touch_widget import TouchWidget

MOST_IMAGES, MOST_REPLAYS = 2, 2


def touch(
    tissue: Tissue | Mapping[str, Tissue],
    model: str | None = None,
    *,
    radius: float | None = None,
    port: int | None = None,
    open_browser: bool = True,
    record: str | Path | None = None,
    replay: Record | Mapping[str, Record] | None = None,
    title: str = "organ",
    images: Sequence[Volume] = (),
    task: str = "",
    device: str | None = None,
    tension: float = 0.0,
    toughness: float | Mapping[int | str, float] | None = None,
    save: str | Path | None = None,
) -> "TouchWidget | None":
    """Open the simulator: in a notebook as a widget, elsewhere in a browser.

    In a notebook the engine runs in the page itself, without a server, if `tissue` is one that `pp.export` takes and nothing
    but `radius`, `title` and `task` is given. Everything else is served on the loopback interface, until Ctrl-C or until the
    kernel is interrupted.

    Parameters
    ----------
    tissue : Tissue or mapping of str to Tissue
        One tissue, or several resolutions of one organ by name. The first one is opened; the page can choose.
    model : str, optional
        A name that `pp.model` knows. The default is the most exact model that keeps 1000 ticks a second on this machine.
        If that takes long to make, a less exact one serves until it is made.
    radius : float, optional
        Radius of the contact, mm. The default is two edge lengths.
    port : int, optional
        Port on loopback. The default is the first free one from 8765 on.
    open_browser : bool, optional
        Whether to open the browser.
    record : str or Path, optional
        File for the session, written at the end. Other resolutions go to files with -2, -3, … in the name. Until then
        a journal grows beside it (`session.h5.journal`); `read_record` reads a session from there that was cut short.
    replay : Record or mapping of str to Record, optional
        A recorded session to show, or two by name, side by side. Model and radius are then the record's, and the tissue
        is the one of `tissue` that it was recorded with.
    title : str, optional
        Title of the page.
    images : sequence of Volume, optional
        Up to two volumes whose slices are shown.
    task : str, optional
        What a trainee is asked to do.
    device : str, optional
        "open-haptics", "force-dimension" or "haply"; it then moves the tool, and the page only shows it.
    tension : float, optional
        Of the tissue at rest, kPa: cuts gape by it in the picture.
    toughness : float or dict, optional
        Energy that a cut takes for each area, J/m², as `cutting_work` takes it. The default is that of the tissues that
        `fit` was given by name.
    save : str or Path, optional
        File (.vtu) for the tissue with its cuts, written at the end.

    Returns
    -------
    TouchWidget or None
        In a notebook, the widget: `force`, `position`, `picked` and `session` are what the hand does, and `tool`, `depth`,
        `view` and `color` can be set. None after a served session.

    Raises
    ------
    DataError
        If there are too many images or records, or a record was made with another tissue.
    MaterialError
        In a notebook, if the engine of the page does not follow the tissue.
    ExtraError
        In a notebook, if the packages of palpate[notebook] are not installed.
    DeviceError
        If the device does not answer.
    PortError
        If the port is taken.
    FileError
        If `record` or `save` cannot be written. All of these are raised before anything starts.

    Examples
    --------
    >>> pp.touch(tissue, record="session.h5")  # doctest: +SKIP
    >>> try:
    ...     pp.touch(tissue, images=[volume] * 3, open_browser=False)
    ... except pp.errors.DataError:
    ...     print("too many images")
    too many images
    """
    served_alone = (port, record, replay, device, save, toughness)  # what a server alone can do
    asked = any(each is not None for each in served_alone)
    needs_server = asked or model not in (None, "compliance") or bool(images) or tension != 0 or not open_browser
    if in_notebook() and isinstance(tissue, Tissue) and not needs_server:
        return touch_widget(tissue, radius, title, task)
    for output in (record, save):
        if output is not None:
            writable(output)
    replays = {title: replay} if isinstance(replay, Record) else dict(replay or {})
    if len(replays) > MOST_REPLAYS:
        raise DataError(
            f"replay: {len(replays)} records given, at most {MOST_REPLAYS} can be shown; leave the others out"
        )
    if replays and record is not None:
        raise DataError("record: a replay is a record already; leave out record or replay")
    if len(images) > MOST_IMAGES:
        raise DataError(f"images: {len(images)} given, at most {MOST_IMAGES} can be shown; leave the others out")
    organs = {title: tissue} if isinstance(tissue, Tissue) else dict(tissue)
    listener = loopback_socket(port)
    with contextlib.closing(listener):
        check_page()
        payloads = image_payloads(images, [f"image {i + 1}" for i in range(len(images))])
        first = next(iter(organs.values()))
        reason = successor = ""
        haptic = None
        if replays:
            live, lines = replayed(replays, organs, tension, payloads), []
        else:
            if model is not None:
                session = Session(build(first, model), radius=radius, tension=tension, toughness=toughness)
            else:
                found = starting_model(first, radius)
                session = Session(found.model, radius=radius, tension=tension, toughness=toughness)
                reason, successor = found.reason, found.successor
            haptic = None if device is None else open_device(device, session.mesh)
            where = None if record is None else Path(record)
            live = LiveSession(
                session, haptic or Pointer(), title, organs, payloads, task, reason, successor, record=where
            )
            lines = [f"it begins with {reason}"] if reason else speed_warning(session)
        serve_until_closed(live, listener, haptic or contextlib.nullcontext(), lines, open_browser)
    if save is not None:
        write_tissue(save, live.session.tissue)
        print(f"palpate: tissue with {live.session.cuts} new cut{'s' * (live.session.cuts != 1)} in {save}")
    return None


def touch_widget(tissue: Tissue, radius: float | None, title: str, task: str) -> "TouchWidget":
    """The widget. Raises `ExtraError`, `MaterialError`, `DataError`, `FileError`."""
    require_extra("pp.touch(tissue, port=8765)")
    from palpate.display.touch_widget import TouchWidget  # its base class is in the extra

    try:
        return TouchWidget(tissue, radius, title, task)
    except MaterialError as problem:
        raise MaterialError(f"{problem}; from a notebook: pp.touch(tissue, port=8765)") from None
