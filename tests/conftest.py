"""What every test starts from."""

import signal

# A runner started in the background may ignore Ctrl-C, and what it starts would too: tests that interrupt need it heard.
signal.signal(signal.SIGINT, signal.default_int_handler)
