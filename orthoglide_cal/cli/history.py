"""`orthocal history`: did the machine change?"""

from pathlib import Path

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import MEASURED, File, Number, Text, argument, option
from orthoglide_cal.errors import InputError


def history(
    sessions: list[str] = argument(
        "FILE", f"Sessions of one machine, or a folder. {MEASURED}.", required=True
    ),
    limit: Number = option(
        "MM", "Largest permitted change; shows when drift reaches it.", min=1e-4
    ),
    dates: Text = option("DATES", "Dates of the files, in order: 2026-03-02,2026-04-07."),
    machine: File = common.MACHINE,
    data: common.Data = common.DATA,
    html: File = common.HTML,
    markdown: File = common.MARKDOWN,
    details: bool = common.DETAILS,
    json: bool = common.JSON,
    overwrite: bool = common.OVERWRITE,
) -> None:
    """Show whether the machine changed between sessions."""
    from orthoglide_cal.files.input import printers_in, sessions_in
    from orthoglide_cal.report.documents.history import history_document
    from orthoglide_cal.results.history import compare
    from orthoglide_cal.session.adjusting import adjusted_since
    from orthoglide_cal.words import counted

    inputs = []
    for given in map(Path, sessions):
        within = [*sessions_in(given), *sorted(printers_in(given))] if given.is_dir() else [given]
        for path in within:
            try:
                inputs.append(common.read_input(str(path), machine, data))
            except InputError as error:
                if path == given:
                    fault = error.problems[0]
                    fault.remedy = f"{fault.remedy} Or leave it out: name the other files.".strip()
                    raise
                common.tell(f"Left out: {error}")
    with common.working(counted(len(inputs), "file")):
        adjusted = {one.measured.source.sha256: adjusted_since(one) for one in inputs}
        comparison = compare(inputs, dates.split(",") if dates else (), limit, adjusted)
    page = history_document(comparison, machine)
    common.deliver(
        page, as_json=json, html=html, markdown=markdown, details=details, overwrite=overwrite
    )
