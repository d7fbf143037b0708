"""`orthocal validate`: everything that is wrong with a file, not only the first thing."""

from __future__ import annotations

from orthoglide_cal.cli.common import (
    AsJson,
    Files,
    MachineFile,
    NoColour,
    for_each,
    output,
    print_json,
)
from orthoglide_cal.errors import InputError


def validate(
    files: Files, machine: MachineFile = None, json: AsJson = False, no_colour: NoColour = False
) -> None:
    """Check files of readings, differences, sessions and machines; name every fault."""
    from orthoglide_cal.data import check_file, read_machine
    from orthoglide_cal.report.check import check_json, check_text

    def judge(path: str) -> int:
        check = check_file(path, read_machine(machine) if machine else None)
        if json:
            print_json(check_json(check))
        else:
            output().print(check_text(check), soft_wrap=True)
        return 0 if check.valid else InputError.exit_code

    for_each(files, judge, as_json=json)
