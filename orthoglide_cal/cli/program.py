"""The entry point: it loads nothing before it can be interrupted."""

import sys


def main() -> None:
    """Run the program `orthocal`; Ctrl-C ends it in silence, also while it is being loaded."""
    try:
        from orthoglide_cal.cli.app import run

        run()
    except KeyboardInterrupt:
        sys.exit(130)
