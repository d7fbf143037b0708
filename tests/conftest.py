"""Programs that the tests start are those of this checkout, and can be interrupted."""

import os
import signal
from pathlib import Path

# Whatever else is installed in this environment, and wherever a test runs the program.
os.environ["PYTHONPATH"] = str(Path(__file__).parents[1])

# A shell starts background jobs with this signal ignored, and children inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
