"""`orthocal solve`: from readings to joint offsets, and whether they may be entered."""

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import File, Text, Texts
from orthoglide_cal.errors import UnusableResultError


def solve(
    files: list[str] = common.FILES,
    machine: File = common.MACHINE,
    data: common.Data = common.DATA,
    rule_out: Texts = common.RULE_OUT,
    method: Text = common.METHOD,
    details: bool = common.DETAILS,
    json: bool = common.JSON,
) -> int:
    """Determine the joint offsets, and whether they may be entered."""
    from orthoglide_cal.report.documents.answer import solution_document

    def judge(path: str) -> int:
        given = common.read_input(path, machine, data, rule_out)
        case = common.judged(given, method=method, details=details or json)
        common.deliver(solution_document(case), as_json=json, details=details)
        return 0 if case.answer.release.usable else UnusableResultError.exit_code

    return common.for_each(files, judge, as_json=json)
