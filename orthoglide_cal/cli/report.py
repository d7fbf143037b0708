"""`orthocal report`: the result in the hands of the people who need it."""

from pathlib import Path

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, File, Number, Offsets, Text, Texts, argument, option
from orthoglide_cal.errors import UnusableResultError, UsageError, command


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
) -> None:
    """Write the calibration report."""
    from orthoglide_cal.files.input import latest_session
    from orthoglide_cal.model.measured import DataKind
    from orthoglide_cal.report.case import Case
    from orthoglide_cal.report.documents.calibration import calibration_document
    from orthoglide_cal.results import answer_to, identify
    from orthoglide_cal.results.verification import verify
    from orthoglide_cal.session.adjusting import adjusted_since

    if after is None and applied is not None:
        raise UsageError("--applied goes with --after.", "Name the later readings.")

    def judge(path: str) -> int:
        given, verification, left = common.read_input(path, machine, data, rule_out), None, None
        with common.working(path):
            case = Case(given, answer_to(given, method, details=True), machine)
        no_differences = given.measured.kinds == (DataKind.READINGS,)
        if limit is not None and no_differences:
            raise UsageError("--limit applies to differences of readings only.", "Leave it out.")
        if after is not None:
            later = common.read_input(after, machine, data)
            if no_differences:
                compare = case.typed("verify", other=after)
                raise UsageError(
                    "The report of a printer shows one file.", f"Compare them: {compare}"
                )
            with common.working(f"{path}, {after}"):
                left = Case(later, answer_to(later, details=True), machine)
                right = command(
                    "report", after, machine=machine, after=path, applied=applied, limit=limit
                )
                compared = verify(given, later, applied, limit, adjusted_since(given), right)
                verification = compared.changed(workspace=left.answer.workspace)
        inputs, options = (verification.inputs, verification.options) if verification else ((), ())
        options = options or (() if limit is None else (limit,))
        judged = [(one.source, one.given.model) for one in (case, *case.others)]
        identity = identify([*judged, *inputs], case.answer.method, machine, *options)
        document = calibration_document(case, identity, verification, limit, left)
        common.deliver(document, as_json=json, html=html, markdown=markdown, overwrite=overwrite)
        failed = verification is not None and verification.failed
        usable = case.answer.release.usable and not failed
        return 0 if usable else UnusableResultError.exit_code

    common.for_each([file or str(latest_session(Path()))], judge, as_json=json)
