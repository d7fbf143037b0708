"""What `report` and `verify` share: where a document goes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orthoglide_cal.cli.common import output, tell
from orthoglide_cal.errors import UsageError

if TYPE_CHECKING:
    from orthoglide_cal.report.blocks import Document

HtmlFile = Annotated[
    Path | None,
    typer.Option(
        "--html",
        metavar="FILE",
        help="Write one HTML page that needs nothing else; - is standard output.",
        show_default=False,
    ),
]
MarkdownFile = Annotated[
    Path | None,
    typer.Option(
        "--markdown",
        metavar="FILE",
        help="Write Markdown; - is standard output.",
        show_default=False,
    ),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")]


def deliver(document: Document, html: Path | None, markdown: Path | None, overwrite: bool) -> None:
    """Write the files asked for, or show the document on the terminal.

    Raises:
        UsageError: a file exists and may not be replaced.
    """
    if html is None and markdown is None:
        from orthoglide_cal.report.terminal import renderable

        output().print(renderable(document))
        return
    if html is not None:
        from orthoglide_cal.report.html import page

        _write(html, page(document), document, overwrite)
    if markdown is not None:
        from orthoglide_cal.report.markdown import markdown as as_markdown

        _write(markdown, as_markdown(document), document, overwrite)


def _write(path: Path, text: str, document: Document, overwrite: bool) -> None:
    if str(path) == "-":
        print(text, end="")
        return
    from orthoglide_cal.data import write_text

    try:
        write_text(path, text, overwrite=overwrite)
    except UsageError as error:
        raise UsageError(error.what, "Name another file, or replace it: --overwrite") from error
    tell(f"{document.kind} {document.number} written to {path}")
