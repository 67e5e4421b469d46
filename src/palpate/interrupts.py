"""Ctrl-C: it ends a command at once, after the file that is being written, or by KeyboardInterrupt that is never lost."""

import _thread
import atexit
import contextlib
import math
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import CodeType, FrameType
from typing import NoReturn

_IMPORTING = "<frozen importlib._bootstrap>"  # where Python loads modules
# Functions that a C library calls which crashes where an exception comes out of one: while one runs, Ctrl-C is put off.
CALLED_BY_C: set[CodeType] = set()
STOPPED = 130  # what a shell expects of a program that Ctrl-C ended
AGAIN = 0.02  # s, after which a KeyboardInterrupt that Python dropped is raised again
PATIENCE = 1.0  # s that a call outside Python may go on after Ctrl-C, and threads after the last word
_insists = threading.Event()  # while a thread sends a signal that was put off again and again


def end_at_once() -> None:
    """From now on Ctrl-C ends the process: while modules are loaded there is nothing to keep."""

    def end(number: int, frame: FrameType | None) -> None:
        os.write(2, b"palpate: stopped\n")
        os._exit(STOPPED)

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not where the shell has it ignored
        signal.signal(signal.SIGINT, end)


@contextlib.contextmanager
def raised() -> Iterator[Callable[[], bool]]:
    """During the block Ctrl-C raises KeyboardInterrupt in the main thread, until one has come through.

    Gives a function that says whether one was raised: some libraries turn it into an exception of their own.

    Python drops what a destructor or a callback of a library lets out, and goes on. It shows it to a hook, though. While
    a module is loaded nothing is raised, and while a call outside Python is busy nothing can be: the process ends if
    that lasts longer than `PATIENCE`.
    """
    handled = [-math.inf]  # when, in s
    before, told = signal.getsignal(signal.SIGINT), sys.unraisablehook

    def interrupt(number: int, frame: FrameType | None) -> None:
        lost = any(code is show.__code__ or code.co_filename == _IMPORTING for code in _running(frame))
        if lost and _again(_insists):
            return  # extension modules that are being made drop exceptions, or abort; the hook would drop it once more
        if time.monotonic() < handled[0] + AGAIN:
            return  # the thread's last signal, sent while the one before was handled
        _insists.clear()
        handled[0] = time.monotonic()
        signal.default_int_handler(number, frame)

    def show(dropped: "sys.UnraisableHookArgs") -> None:
        if issubclass(dropped.exc_type, KeyboardInterrupt):
            _again(_insists)
        else:
            told(dropped)

    def was_raised() -> bool:
        return math.isfinite(handled[0])

    if before is signal.SIG_IGN or threading.current_thread() is not threading.main_thread():
        yield was_raised
        return
    with _watched(interrupt, handled):
        try:
            sys.unraisablehook = show
            signal.signal(signal.SIGINT, interrupt)
            yield was_raised
        finally:
            _insists.clear()
            signal.signal(signal.SIGINT, before)
            sys.unraisablehook = told


def end_process() -> NoReturn:
    """Ends the process, temporary files removed.

    Threads may still be at work: Python's own end would wait for them, or take away what they use. They get `PATIENCE`.
    """
    _after(PATIENCE, os._exit, STOPPED)
    atexit._run_exitfuncs()
    with contextlib.suppress(OSError, ValueError):  # a pipe that is closed
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(STOPPED)


@contextlib.contextmanager
def _watched(interrupt: Callable[[int, FrameType | None], None], handled: list[float]) -> Iterator[None]:
    """During the block a thread ends the process if `interrupt` does not run soon after a signal for it has come.

    Python writes a byte to a socket as soon as a signal comes, even within a call that is not Python's.
    """
    told, tells = socket.socketpair()
    tells.setblocking(False)

    def watch() -> None:
        with told:
            while number := told.recv(1):
                came = time.monotonic()
                while number[0] == signal.SIGINT and signal.getsignal(signal.SIGINT) is interrupt:
                    if handled[0] > came - PATIENCE:  # this thread may be late
                        break
                    if time.monotonic() > came + PATIENCE:
                        os.write(2, b"palpate: stopped within a long step; files under their final names are whole\n")
                        os._exit(STOPPED)
                    time.sleep(AGAIN)

    before = signal.set_wakeup_fd(tells.fileno(), warn_on_full_buffer=False)
    watched = _after(0, watch)
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        tells.close()
        if not watched:
            told.close()


@contextlib.contextmanager
def waiting() -> Iterator[None]:
    """During the block Ctrl-C waits for its end; a second one does not, except within `CALLED_BY_C`."""
    if threading.current_thread() is not threading.main_thread():  # only there do signals arrive
        yield
        return
    came = False
    second = threading.Event()  # one that came within `CALLED_BY_C`; any after it are the same one

    def wait(number: int, frame: FrameType | None) -> None:
        nonlocal came
        if not came or _insists.is_set():  # what is sent again is the first one still
            came = True
        elif CALLED_BY_C.isdisjoint(_running(frame)) or not _again(second):
            second.clear()
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, wait)
    try:
        yield
    finally:
        second.clear()
        signal.signal(signal.SIGINT, signal.SIG_DFL if before is None else before)
    if came:
        signal.raise_signal(signal.SIGINT)


def _running(frame: FrameType | None) -> Iterator[CodeType]:
    """The code of this frame and of all that wait for it."""
    while frame is not None:
        yield frame.f_code
        frame = frame.f_back


def _again(wanted: threading.Event) -> bool:
    """Has a thread send Ctrl-C again and again until `wanted` is cleared. False: the system gives no more threads."""

    def insist() -> None:
        while wanted.is_set():
            interrupt_main()
            time.sleep(AGAIN)

    if not wanted.is_set():
        wanted.set()  # first: the signal may come while the thread is being started
        if not _after(AGAIN, insist):
            wanted.clear()
    return wanted.is_set()


def _after(seconds: float, call: Callable[..., None], *values: int) -> bool:
    """Calls it after so many seconds, from a thread that keeps nothing alive. False: the system gives no more threads."""
    timer = threading.Timer(seconds, call, values)
    timer.daemon = True
    try:
        timer.start()
    except RuntimeError:
        return False
    return True


def interrupt_main() -> None:
    """Does in the main thread what Ctrl-C does."""
    if sys.platform == "win32":
        _thread.interrupt_main()
    else:  # also out of a system call
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
