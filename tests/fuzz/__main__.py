"""`python -m tests.fuzz`: 100,000 mutants, every sixth of a firmware's file, through all commands.

Prints each failure and returns 1 if there are any.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from .run import Fuzz

parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
parser.add_argument("--count", type=int, default=100_000)
parser.add_argument("--seed", type=int, default=1)
given = parser.parse_args()
failures, foreign = 0, given.count // 6
for firmwares, count in ((False, given.count - foreign), (True, foreign)):
    with tempfile.TemporaryDirectory() as folder:
        for failure in Fuzz(Path(folder), given.seed, firmwares).run(count):
            failures += 1
            print(failure, flush=True)
print(f"{given.count} mutants, {failures} failures", file=sys.stderr)
sys.exit(failures > 0)
