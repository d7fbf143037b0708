"""`orthocal solve`: from readings to joint offsets."""

from __future__ import annotations

from orthoglide_cal.cli import common


def solve(
    files: common.Files,
    machine: common.MachineFile = None,
    method: common.MethodName = None,
    json: common.AsJson = False,
    no_colour: common.NoColour = False,
) -> None:
    """Find the joint offsets, how sure they are, and whether the model fits."""
    from orthoglide_cal import estimation
    from orthoglide_cal.report.documents.solution import solution_document

    def judge(path: str) -> None:
        given = common.read_input(path, machine)
        solution = estimation.solve(given.measured, given.model, method)
        common.deliver(solution_document(solution, machine), as_json=json)

    common.for_each(files, judge, as_json=json)
