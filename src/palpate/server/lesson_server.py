"""A lesson taken: its case behind the page of `touch`, as an exam."""

import contextlib
from pathlib import Path

from palpate.atomic_write import writable
from palpate.errors import DataError
from palpate.haptics.discovery import open_device
from palpate.server.access_control import check_page
from palpate.server.exam import Exam
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serve_until_closed
from palpate.simulation.forced_choice import CHANNELS
from palpate.simulation.lesson import Lesson
from palpate.simulation.pointer import Pointer
from palpate.simulation.session import Session
from palpate.tissue.models.registry import model as build


def take_lesson(
    lesson: Lesson,
    seed: int,
    *,
    record: str | Path | None = None,
    channel: str = "screen",
    device: str | None = None,
    port: int | None = None,
    open_browser: bool = True,
) -> None:
    """Open a case of a lesson in a browser, as an exam, and wait for Ctrl-C.

    The page gets no part inside, no estimate and no slices. Positions and forces come in the steps of a screen.

    Parameters
    ----------
    lesson : Lesson
        The lesson.
    seed : int
        Which case.
    record : str or Path, optional
        File for the session, which `lesson_result` judges.
    channel : {"screen", "sound", "gamepad", "device"}, optional
        How the force comes to the trainee; with a `device` it is "device".
    device : str, optional
        "open-haptics", "force-dimension" or "haply".
    port : int, optional
        Port on loopback.
    open_browser : bool, optional
        Whether to open the browser.

    Raises
    ------
    DataError
        If the channel is none, or the case cannot be drawn.
    FileError
        If the organ cannot be read or the record cannot be written.
    PortError
        If the port is taken. All of these are raised before anything starts.

    Examples
    --------
    >>> pp.take_lesson(pp.read_lesson("lesson.yaml"), seed=7, record="session.h5")  # doctest: +SKIP
    >>> try:
    ...     pp.take_lesson(pp.Lesson("One", Path("tissue.vtu"), "", ""), seed=7, channel="smell")
    ... except pp.errors.DataError:
    ...     print("no such channel")
    no such channel
    """
    channel = channel if device is None else "device"
    if channel not in CHANNELS:
        raise DataError(f"channel: {channel!r} is none; choose one of {', '.join(CHANNELS)}")
    if record is not None:
        writable(record)
    listener = loopback_socket(port)
    with contextlib.closing(listener):
        check_page()
        exam = Exam(lesson, seed, channel)
        session = exam_session(exam)
        haptic = None if device is None else open_device(device, session.mesh)
        where = None if record is None else Path(record)
        live = LiveSession(session, haptic or Pointer(), lesson.title, task=lesson.asked, record=where, exam=exam)
        lines = [f"case {seed}; it trains {lesson.trains}; it cannot train {lesson.cannot}"]
        serve_until_closed(live, listener, haptic or contextlib.nullcontext(), lines, open_browser)


def exam_session(exam: Exam) -> Session:
    """The session of an exam's case. Raises `FileError` and `DataError`."""
    session = Session(build(exam.case(), "compliance"), regions=False)
    session.lesson = exam.description
    return session
