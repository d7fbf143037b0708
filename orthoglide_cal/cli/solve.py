"""`orthocal solve`: from readings to joint offsets, and whether they may be entered."""

from __future__ import annotations

from orthoglide_cal.cli import common
from orthoglide_cal.errors import UnusableResultError


def solve(
    files: common.Files,
    machine: common.MachineFile = None,
    data: common.Data = None,
    method: common.MethodName = None,
    json: common.AsJson = False,
    no_colour: common.NoColour = False,
) -> None:
    """Find the joint offsets, how sure they are, and whether they may be entered."""
    from orthoglide_cal import results
    from orthoglide_cal.report.documents.solution import solution_document

    def judge(path: str) -> int:
        found = results.calibrate(common.read_input(path, machine, data), method)
        common.deliver(solution_document(found, machine), as_json=json)
        return 0 if found.release.sound else UnusableResultError.exit_code

    common.for_each(files, judge, as_json=json)
