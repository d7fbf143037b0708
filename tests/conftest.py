"""For all tests."""

import signal

# Started in the background, a shell lets its jobs ignore Ctrl-C, and so would every program that
# the tests start. A handler here makes them begin with the default again.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
