"""`orthocal report`: the result in the hands of the people who need it."""

from pathlib import Path

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, File, Number, Offsets, Text, Texts, argument, option
from orthoglide_cal.errors import InputError, UnusableResultError, UsageError, command


def report(
    file: Text = argument(
        "FILE",
        f"{MEASURED}; - is standard input. Default: the latest session in this folder.",
    ),
    machine: File = common.MACHINE,
    data: common.Data = common.DATA,
    rule_out: Texts = common.RULE_OUT,
    method: Text = common.METHOD,
    html: File = common.HTML,
    markdown: File = common.MARKDOWN,
    json: bool = common.JSON,
    overwrite: bool = common.OVERWRITE,
    after: Text = option(
        "FILE", "Measured after the adjustment: shown as left and compared with the prediction."
    ),
    applied: Offsets = common.APPLIED,
    limit: Number = common.LIMIT,
) -> int:
    """Write the calibration report."""
    from orthoglide_cal.files.input import sessions_in
    from orthoglide_cal.model.measured import DataKind
    from orthoglide_cal.report.documents.reports import calibration_document
    from orthoglide_cal.results.answer import identify
    from orthoglide_cal.results.verification import verify
    from orthoglide_cal.session.adjusting import adjusted_since

    if after is None and applied is not None:
        raise UsageError("--applied goes with --after.", "Name the later readings.")
    path = file or next(map(str, reversed(sessions_in(Path()))), None)
    if path is None:
        remedy = "Name a file of readings, or measure first: orthocal measure"
        raise InputError("There is no session in this folder.", remedy, file=".")
    given, verification, left = common.read_input(path, machine, data, rule_out), None, None
    case = common.judged(given, method=method, details=True)
    no_differences = given.measured.kinds == (DataKind.READINGS,)
    if limit is not None and no_differences:
        raise UsageError("--limit applies to differences of readings only.", "Leave it out.")
    judged = [given, *given.others]
    if after is not None:
        later = common.read_input(after, machine, data)
        if no_differences:
            compare = f"Compare them: {case.typed('verify', other=after)}"
            raise UsageError("The report of a printer shows one file.", compare)
        right = command("report", after, machine=machine, after=path, applied=applied, limit=limit)
        left = common.judged(later, details=True)
        with common.working(f"{path}, {after}"):
            verification = verify(given, later, applied, limit, adjusted_since(given), right)
        judged += verification.inputs
    options = filter(None, (verification and verification.applied_mm, limit))
    identity = identify(judged, case.answer.method, machine, *options)
    document = calibration_document(case, identity, verification, limit, left)
    common.deliver(document, as_json=json, html=html, markdown=markdown, overwrite=overwrite)
    usable = case.answer.release.usable and not (verification and verification.failed)
    return 0 if usable else UnusableResultError.exit_code
