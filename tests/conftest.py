"""What all tests share."""

import signal

# A shell that starts the tests in the background leaves Ctrl-C ignored, here and in every process that
# is started from here; the tests of an interrupted run send it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
