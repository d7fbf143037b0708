"""What the commands share: options, input, output streams, errors to exit codes.

Heavy modules are imported inside the functions that need them, so that `--help` stays fast.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TextIO

import typer

from orthoglide_cal.errors import InputError, OrthocalError, UsageError, file_words

if TYPE_CHECKING:
    from rich.console import Console

    from orthoglide_cal.files import Input
    from orthoglide_cal.model import Model
    from orthoglide_cal.report.document import Document


def _switch_colour_off(chosen: bool) -> bool:
    # The environment is where rich and every child process look for it.
    if chosen:
        os.environ["NO_COLOR"] = "1"
    return chosen


def option(*names: str, metavar: str | None = None, help: str, **limits: Any) -> Any:
    """An option whose default says nothing to the user (it is not shown in the help)."""
    return typer.Option(*names, metavar=metavar, help=help, show_default=False, **limits)


Files = Annotated[
    list[str],
    typer.Argument(
        metavar="FILE...",
        help="Readings or differences (CSV), or a session (YAML); - is standard input.",
        show_default=False,
    ),
]
MachineFile = Annotated[
    Path | None,
    option(
        "--machine",
        metavar="FILE",
        help="Machine file; without it the session's own machine, or the prototype.",
    ),
]
MethodName = Annotated[
    str | None,
    option(
        "--method",
        metavar="NAME",
        help="single, single-sequential, six-linear, twelve-linear, six, twelve or readings;"
        " without it the best one for the data.",
    ),
]
Offsets = tuple[float, float, float]
Limit = Annotated[
    float | None,
    option(
        metavar="MM", help="Largest deviation allowed in any difference: pass, fail or undecided."
    ),
]
HtmlFile = Annotated[
    Path | None,
    option(
        metavar="FILE", help="Write one HTML page that needs nothing else; - is standard output."
    ),
]
MarkdownFile = Annotated[
    Path | None, option(metavar="FILE", help="Write Markdown; - is standard output.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")]
AsJson = Annotated[
    bool, typer.Option("--json", help="One JSON object per input file, one per line.")
]
NoColour = Annotated[
    bool,
    typer.Option("--no-color", help="No colours (as NO_COLOR does).", callback=_switch_colour_off),
]


def for_each(
    files: Sequence[str], judge: Callable[[str], int | None], *, as_json: bool = False
) -> NoReturn:
    """Judge each file alone, in order; the worst exit code wins.

    Args:
        files: paths as the user gave them; "-" is standard input.
        judge: shows the result for one path; returns its exit code (None: 0).
        as_json: a file that fails gives {"input": …, "error": …} on standard output in its
            place; otherwise a message on standard error.
    """
    worst = 0
    for path in files:
        try:
            code = judge(path) or 0
        except OrthocalError as error:
            code = error.exit_code
            if as_json:
                print_json({"input": {"path": path}, "error": str(error)})
            else:
                tell_error(error, path)
        worst = max(worst, code)
    raise typer.Exit(worst)


def read_input(path: str, machine_file: Path | None = None) -> Input:
    """What was measured at `path` ("-": standard input), judged by the machine of --machine."""
    from orthoglide_cal import files

    return files.read_input(path, given_machine(machine_file))


@functools.cache
def given_machine(machine_file: Path | None) -> Model | None:
    """The machine of --machine, read once for many inputs; None if it was not given."""
    from orthoglide_cal import files

    return files.read_machine(machine_file) if machine_file else None


def deliver(
    document: Document,
    *,
    as_json: bool = False,
    html: Path | None = None,
    markdown: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Show a document on standard output, as text or as JSON, or write the files asked for.

    Raises:
        UsageError: a file exists and may not be replaced.
    """
    if as_json:
        print_json(document.data())
        return
    page = document.page()
    if html is None and markdown is None:
        from orthoglide_cal.report.terminal import Terminal

        output().print(Terminal(page), crop=False)
    if html is not None:
        from orthoglide_cal.report.html import html as as_html

        _write(html, as_html(page), page.name, overwrite)
    if markdown is not None:
        from orthoglide_cal.report.markdown import markdown as as_markdown

        _write(markdown, as_markdown(page), page.name, overwrite)


def _write(path: Path, text: str, name: str, overwrite: bool) -> None:
    if str(path) == "-":
        print(text, end="")
        return
    from orthoglide_cal.files import write_text

    try:
        write_text(path, text, overwrite=overwrite)
    except UsageError as error:
        raise UsageError(error.what, "Name another file, or replace it: --overwrite") from error
    tell(f"{name} written to {path}")


def print_json(value: Mapping[str, Any]) -> None:
    """One JSON object on one line of standard output; NaN is refused."""
    from orthoglide_cal.report.json import json_line

    print(json_line(value), flush=True)


def output() -> Console:
    """Console for results, on standard output."""
    return _console(stderr=False)


def messages() -> Console:
    """Console for messages and progress, on standard error."""
    return _console(stderr=True)


def _console(*, stderr: bool) -> Console:
    from rich.console import Console

    class Terminal(Console):
        """Leaves a closed pipe to the program, where rich would exit with code 1."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    plain = bool(os.environ.get("NO_COLOR"))
    return Terminal(
        stderr=stderr,
        color_system=None if plain else "auto",
        highlight=False,
        markup=False,
        emoji=False,
    )


def tell(message: str) -> None:
    """A message on standard error; what file names and the like hold is shown, never obeyed."""
    from orthoglide_cal.errors import visible_lines

    print(visible_lines(message), file=sys.stderr)


def tell_error(error: OrthocalError, path: str = "") -> None:
    """An error on standard error, with the input's name in front unless the error has it."""
    named = isinstance(error, InputError) and error.file
    tell(f"{file_words(path)}: {error}" if path and not named else str(error))


def leave_closed(*streams: TextIO) -> None:
    """The reader of a stream has gone (`| head`, a closed window): stop writing to it in silence.

    Python would complain at its end of what it could not write, with an exit code of its own.
    """
    for stream in streams:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
