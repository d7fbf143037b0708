"""`orthocal validate`: everything that is wrong with a file, not only the first thing."""

from __future__ import annotations

from orthoglide_cal.cli import common
from orthoglide_cal.errors import InputError


def validate(
    files: common.Files,
    machine: common.MachineFile = None,
    json: common.AsJson = False,
    no_colour: common.NoColour = False,
) -> None:
    """Check files of readings, differences, sessions and machines; name every fault."""
    from orthoglide_cal.files import check_file
    from orthoglide_cal.report.documents.checks import check_document

    def judge(path: str) -> int:
        check = check_file(path, common.given_machine(machine))
        common.deliver(check_document(check), as_json=json)
        return 0 if check.valid else InputError.exit_code

    common.for_each(files, judge, as_json=json)
