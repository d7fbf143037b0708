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
        given = common.read_input(path, machine, data)
        if json:
            answer = results.answer_to(given, method, details=True)
            answer.require_result()
            common.print_json(answer.model_dump(mode="json"))
            return 0 if answer.release.usable else UnusableResultError.exit_code
        found = results.calibrate(given, method)
        common.deliver(solution_document(found, machine))
        return 0 if found.release.usable else UnusableResultError.exit_code

    common.for_each(files, judge, as_json=json)
