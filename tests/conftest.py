"""What holds for all tests."""

import signal


def pytest_configure(config):
    """Ctrl-C reaches the programs that tests start, even if this one runs in a shell's background, which ignores it.

    An ignored signal is inherited; a handled one is not.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
