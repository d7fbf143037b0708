"""`python -m tests.bench`: run the blind bench and print everything."""

import argparse
import sys
from dataclasses import fields, replace
from pathlib import Path

from tests.truth import GAUGES, MACHINES

from .beyond import draw_beds, draw_hidden, failures_beyond, report_beyond, run_beyond
from .cases import FULL, FULL_PRINTERS, draw_gauges, draw_printers
from .report import failures, full_report
from .run import run_bench


def main(arguments: list[str] | None = None) -> int:
    """Returns 1 if a demand is missed."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("--printers", action="store_true", help="linear deltas and their probes")
    for name, about in (
        ("single", "per cause"),
        ("healthy", "without a cause"),
        ("outside", "per effect outside the list"),
        ("pair", "per combination"),
        ("largest", "places of a printer's layout"),
    ):
        parser.add_argument(f"--{name}", type=int, help=about)
    parser.add_argument("--holdouts", type=int, default=2, help="second sessions per cause, group")
    parser.add_argument("--beyond", type=int, help="sessions beyond the list, and nothing else")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--machine", choices=MACHINES, action="append")
    parser.add_argument("--gauge", choices=GAUGES, action="append")
    parser.add_argument("--keep", type=Path, help="folder for the records and answers")
    given = parser.parse_args(arguments)
    usual = FULL_PRINTERS if given.printers else FULL
    asked = {item.name: getattr(given, item.name) for item in fields(usual)}
    counts = replace(usual, **{name: value for name, value in asked.items() if value is not None})
    machines = [MACHINES[name] for name in given.machine or MACHINES]
    gauges = [GAUGES[name] for name in given.gauge or GAUGES]
    if given.beyond:
        hidden = (
            draw_beds(given.beyond, given.seed)
            if given.printers
            else draw_hidden(machines, gauges, given.beyond, given.seed)
        )
        described = run_beyond(hidden, given.keep)
        print(report_beyond(described))
        return int(bool(failures_beyond(described)))
    drawn = (
        draw_printers(counts, given.seed)
        if given.printers
        else draw_gauges(machines, gauges, counts, given.seed)
    )
    bench = run_bench(drawn, 0 if given.printers else given.holdouts, given.seed, given.keep)
    print(full_report(bench))
    return int(bool(failures(bench)))


if __name__ == "__main__":
    sys.exit(main())
