"""What every test starts from."""

import signal

from hypothesis import settings

# A runner started in the background may ignore Ctrl-C, and what it starts would too: tests that interrupt need it heard.
signal.signal(signal.SIGINT, signal.default_int_handler)

# No test is judged by its time: a busy machine and the sanitizers are slow.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
