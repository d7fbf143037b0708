"""`python -m tests.bench`: run the blind bench and print everything."""

import argparse
import sys
from pathlib import Path

from tests.truth import GAUGES, MACHINES

from .bench import Setting, run_bench
from .cases import Counts
from .report import failures, full_report


def main(arguments: list[str] | None = None) -> int:
    """Returns 1 if a demand is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("--sessions", type=int, default=20, help="per cause and group")
    parser.add_argument("--healthy", type=int, default=125, help="per group")
    parser.add_argument("--outside", type=int, default=5, help="per kind and group")
    parser.add_argument("--pairs", type=int, default=2, help="per combination and group")
    parser.add_argument("--holdouts", type=int, default=2, help="second sessions per cause, group")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--machine", choices=MACHINES, action="append")
    parser.add_argument("--gauge", choices=GAUGES, action="append")
    parser.add_argument("--by", choices=("distance", "margin"), default="distance")
    parser.add_argument("--keep", type=Path, help="folder for the records and answers")
    given = parser.parse_args(arguments)
    counts = Counts(given.sessions, given.healthy, given.outside, given.pairs)
    setting = Setting(counts, given.seed, given.by, given.holdouts, given.keep)
    machines = [MACHINES[name] for name in given.machine or MACHINES]
    gauges = [GAUGES[name] for name in given.gauge or GAUGES]
    groups = run_bench(machines, gauges, setting, lambda text: print(text, file=sys.stderr))
    print(full_report(groups))
    return int(bool(failures(groups)))


if __name__ == "__main__":
    sys.exit(main())
