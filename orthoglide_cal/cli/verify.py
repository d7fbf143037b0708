"""`orthocal verify`: did a correction help?"""

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, File, Number, Offsets, argument
from orthoglide_cal.errors import UnusableResultError, command


def verify(
    before: str = argument("BEFORE", f"Measured before the correction. {MEASURED}.", required=True),
    after: str = argument(
        "AFTER", "Measured after the correction, with the same protocol.", required=True
    ),
    applied: Offsets = common.APPLIED,
    limit: Number = common.LIMIT,
    machine: File = common.MACHINE,
    data: common.Data = common.DATA,
    html: File = common.HTML,
    markdown: File = common.MARKDOWN,
    details: bool = common.DETAILS,
    json: bool = common.JSON,
    overwrite: bool = common.OVERWRITE,
) -> int:
    """Compare the predicted effect of a correction with the real one."""
    from orthoglide_cal.report.documents.reports import verification_document
    from orthoglide_cal.results.verification import verify as verified
    from orthoglide_cal.session.adjusting import adjusted_since

    inputs = common.read_input(before, machine, data), common.read_input(after, machine, data)
    with common.working(f"{before}, {after}"):
        right = command("verify", after, before, machine=machine, applied=applied, limit=limit)
        result = verified(*inputs, applied, limit, adjusted_since(inputs[0]), right)
    page = verification_document(result)
    common.deliver(
        page, as_json=json, html=html, markdown=markdown, details=details, overwrite=overwrite
    )
    return UnusableResultError.exit_code if result.failed else 0
