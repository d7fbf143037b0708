"""Programs that the tests start can be interrupted, also where the tests run in the background."""

import signal

# A shell starts background jobs with this signal ignored, and children inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
