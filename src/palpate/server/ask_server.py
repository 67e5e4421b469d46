"""A forced-choice experiment behind the page of `touch`."""

import asyncio
import contextlib
from pathlib import Path

from palpate.atomic_write import writable
from palpate.errors import DataError
from palpate.haptics.discovery import open_device
from palpate.server.access_control import check_page
from palpate.server.forced_choice_run import ForcedChoiceRun
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import announce, loopback_socket, show, shutdown_requests
from palpate.server.touch import running_session
from palpate.simulation.answer_file import Answers, read_answers, start_answers
from palpate.simulation.forced_choice import ForcedChoice
from palpate.simulation.interval_tissue import stimulus
from palpate.simulation.pointer import Pointer
from palpate.simulation.session_compatibility import tissue_hash
from palpate.tissue.models.registry import model as build
from palpate.tissue.tissue import Tissue

CLOSING = 2.0  # s after the last answer: the page has said so by then


def ask(
    organ: Tissue,
    output: str | Path,
    experiment: ForcedChoice | None = None,
    *,
    resume: bool = False,
    device: str | None = None,
    port: int | None = None,
    open_browser: bool = True,
    title: str = "organ",
) -> Answers:
    """Ask a person in a browser, trial by trial, until the procedure is done or Ctrl-C.

    Each trial has two intervals, which can be palpated in turn as often as the person likes. Until the organ is touched,
    the page gets the same bytes for both. Each answer is on the disk before the next trial begins.

    Parameters
    ----------
    organ : Tissue
        The organ.
    output : str or Path
        File for the answers (.jsonl).
    experiment : ForcedChoice, optional
        What is asked.
    resume : bool, optional
        Go on with the answers in `output`, by the same experiment.
    device : str, optional
        "open-haptics", "force-dimension" or "haply"; then the channel must be "device".
    port : int, optional
        Port on loopback.
    open_browser : bool, optional
        Whether to open the browser.
    title : str, optional
        Title of the page.

    Returns
    -------
    Answers
        What was answered so far.

    Raises
    ------
    DataError
        If the organ cannot be used, or the answers there are of another experiment.
    FileError
        If the output cannot be written, is there already, or holds no answers.
    PortError
        If the port is taken. All of these are raised before anything starts.

    Examples
    --------
    >>> pp.ask(tissue, "answers.jsonl", pp.ForcedChoice("stiffness", trials=40))  # doctest: +SKIP
    >>> try:
    ...     pp.ask(tissue, "missing/answers.jsonl", open_browser=False)
    ... except pp.errors.FileError:
    ...     print("no such folder")
    no such folder
    """
    experiment = experiment or ForcedChoice()
    if (device is None) == (experiment.channel == "device"):
        raise DataError(
            f"channel: {experiment.channel!r} with device {device}; name the device, and only for its channel"
        )
    path = writable(output)
    listener = loopback_socket(port)
    with contextlib.closing(listener):
        check_page()
        what = stimulus(experiment, organ)
        answers = _answers(path, experiment, organ, resume)
        if answers.next_level is None:
            return answers
        run = ForcedChoiceRun(answers, path, build(what.tissue(organ, 0.0), "compliance"), what)
        haptic = None if device is None else open_device(device, organ.mesh)
        live = LiveSession(run.intervals[0], haptic or Pointer(), title, exam=run)
        with (
            shutdown_requests() as ended,
            running_session(live, listener) as address,
            haptic or contextlib.nullcontext(),
        ):
            run.finished = lambda: asyncio.get_running_loop().call_later(CLOSING, ended.put, 1)
            announce(address, f"{experiment.asked} Answer", [f"answers go to {path}"])
            show(address, ended, open_browser)
    return run.answers


def _answers(path: Path, experiment: ForcedChoice, organ: Tissue, resume: bool) -> Answers:
    """Those in the file, which is begun if it shall not be resumed."""
    fresh = Answers(experiment, tissue_hash(organ))
    if not resume:
        start_answers(path, fresh)
        return fresh
    found = read_answers(path)
    if found.organ != fresh.organ:
        raise DataError(f"{path}: its answers are about another organ; give the same tissue")
    if found.experiment != experiment:
        names = [name for name in vars(experiment) if getattr(found.experiment, name) != getattr(experiment, name)]
        was = ", ".join(f"{name} {getattr(found.experiment, name)}" for name in names)
        raise DataError(f"{path}: its answers were asked with {was}; give the same, or begin another file")
    return found
