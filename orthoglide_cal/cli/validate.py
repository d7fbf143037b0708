"""`orthocal validate`: everything that is wrong with a file."""

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import File
from orthoglide_cal.errors import InputError, UnusableResultError


def validate(
    files: list[str] = common.FILES,
    machine: File = common.MACHINE,
    data: common.Data = common.DATA,
    json: bool = common.JSON,
) -> int:
    """Check files; name every fault with its place and remedy."""
    from orthoglide_cal.estimation.arms import free_arms
    from orthoglide_cal.files.input import check_file
    from orthoglide_cal.inference.alone import solve
    from orthoglide_cal.model.measured import Source
    from orthoglide_cal.report.documents.short import check_document

    def judge(path: str) -> int:
        check, given = check_file(path, common.known_machine(machine), common.usual_machine, data)
        source = given.measured.source if given else Source(path, check.input.sha256 or "")
        if check.valid:
            common.require_printer(source, data)
        if given:
            try:
                freed = free_arms(given)
                solve(freed.measured, freed.model)
            except UnusableResultError as error:
                check = check.changed(refused=error)
        common.deliver(check_document(check, source), as_json=json)
        if check.refused:
            return check.refused.exit_code
        return 0 if check.valid else InputError.exit_code

    return common.for_each(files, judge, as_json=json)
