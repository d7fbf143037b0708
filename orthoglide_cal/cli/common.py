"""Parts that the commands share: options, input, output streams, errors to exit codes.

Heavy modules are imported inside the functions that need them, so that `--help` stays fast.
"""

from __future__ import annotations

import gc
import math
import os
import re
import shutil
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TextIO

import typer
from typer.core import TyperCommand

from orthoglide_cal.errors import (
    InputError,
    OrthocalError,
    UsageError,
    file_words,
    visible,
    visible_lines,
)
from orthoglide_cal.schema import parse_count, parse_number
from orthoglide_cal.words import MM, wrapped

if TYPE_CHECKING:
    from rich.console import Console

    from orthoglide_cal.files.input import Input
    from orthoglide_cal.files.machine_file import StoredMachine
    from orthoglide_cal.files.printer_file import PrinterFile
    from orthoglide_cal.model.measured import Source
    from orthoglide_cal.model.model import Model
    from orthoglide_cal.report.case import Case
    from orthoglide_cal.report.document import Document

NO_COLOUR = "no_colour"
INTERRUPTED = 130  # exit code
# Numbers on the command line are lengths in mm, or degrees: none of them is as large.
LARGEST = 1e5
# What the help calls a number → the units that may follow it, each in that of the number alone.
_UNITS: Mapping[str | None, Mapping[str, float]] = {
    **dict.fromkeys(("MM", "DX DY DZ", "LOW HIGH"), MM),
    "C": dict.fromkeys(("°C", "C"), 1.0),
    "SHARE": {},
    "DR DA DB": {},
}
_WITH_UNIT = re.compile(r"(.*[0-9.,])\s*(\D*)")
SLOW_S = 2.0


class PlainCommand(TyperCommand):
    """One command, with the program's own options and plain metavariables."""

    def get_params(self, ctx: Any) -> Any:
        parameters: list[Any] = super().get_params(ctx)
        # The program's own option is every command's; the last one is --help.
        parameters[-1:-1] = (p for p in ctx.find_root().command.params if p.name == NO_COLOUR)
        for parameter in parameters:
            # The help would call files `<list[str]>`, and a choice `<this|that>`.
            named = parameter.param_type_name == "argument"
            shown = "" if named else parameter.display_type_rich(ctx)
            parameter.display_type_rich = lambda ctx, shown=shown: (shown or "").strip("<>")
        return parameters

    def invoke(self, ctx: Any) -> Any:
        if ctx.params.pop(NO_COLOUR):
            os.environ["NO_COLOR"] = "1"  # for rich and every child process
        # As JSON every error names its input, the first one where a command has several.
        first = next((p.name for p in self.params if p.param_type_name == "argument"), None)
        ctx.find_root().obj = ctx.params.get(first)
        raise typer.Exit(super().invoke(ctx) or 0)  # what a command returns is its exit code


def option(
    metavar: str | None,
    help: str,
    *names: str,
    min: float | None = None,
    max: float | None = None,
    default: object = None,
) -> Any:
    """An option with a value; its help says what holds without it. Its name is the parameter's.

    Numbers are read as in a session: with a point or a comma, and a unit where they have one.
    """

    def number(given: object) -> float:
        text, units = str(given).strip(), _UNITS.get(metavar)
        try:
            if units is None:
                value: float = parse_count(text, int(low))
            else:
                match = _WITH_UNIT.fullmatch(text)
                digits, unit = match.groups() if match else (text, "")
                if unit and unit not in units:
                    sizes = dict.fromkeys(units.values())
                    first = (next(u for u in units if units[u] == size) for size in sizes)
                    known = ", ".join(first) or "none"
                    raise InputError("This unit is not known.", f"Known here: {known}.", value=text)
                value = round(parse_number(digits, decimal_comma=True) * units.get(unit, 1.0), 12)
            if not low <= value <= high:
                limits = f"Give a number from {low:g} to {high:g}."
                raise InputError("The number is too large or too small.", limits, value=text)
        except InputError as error:
            raise typer.BadParameter(str(error)) from error
        return value

    counts = metavar == "N"
    low = -LARGEST if min is None else min
    high = (math.inf if counts else LARGEST) if max is None else max
    parser = number if counts or metavar in _UNITS else None
    return typer.Option(
        default, *names, metavar=metavar, help=help, show_default=False, parser=parser
    )


def flag(name: str, help: str) -> Any:
    """An option without a value."""
    return typer.Option(False, name, help=help)


def argument(
    metavar: str,
    help: str,
    complete: Callable[[str], list[str]] | None = None,
    required: bool = False,
) -> Any:
    """An argument, which has no name; `complete` lists what may follow what was typed of it."""
    default = ... if required else None
    return typer.Argument(
        default, metavar=metavar, help=help, show_default=False, autocompletion=complete
    )


MEASURED = "Readings or differences (CSV), a session (YAML), or a printer's file (printer.cfg …)"
# What may be left out.
Text = str | None
Texts = list[str] | None
Count = int | None
Number = float | None
File = Path | None
Offsets = tuple[float, float, float] | None
Protocol = Literal["double", "single"] | None
Design = Literal["best"] | None
Order = Literal["paper", "fewest-moves"] | None
Data = Literal["calibration", "mesh"] | None  # of a printer.cfg
# Options of several commands.
FILES = argument("FILE", f"{MEASURED}; - is standard input.", required=True)
MACHINE = option(
    "FILE",
    "Machine file. Default: the machine in the session, or the machine file in this folder, or"
    " the paper's prototype.",
)
METHOD = option(
    "NAME",
    "single, single-sequential, six-linear, twelve-linear, six, twelve or readings. Default:"
    " the best one for the data.",
)
DATA = option(
    None, "Which data of a printer.cfg to use. Default: the calibration, if there is one."
)
CYCLES = option("N", "Number of cycles, 1 to 50. Default: 3.", min=1, max=50)
GAUGES = option("N", "Gauges in use, 1 or 2. Default: 2; single: 1.", min=1, max=2)
PROTOCOL = option(None, "Protocol: double-posture (default) or single-posture.")
DESIGN = option(
    None, "The design with the fewest readings for the offsets; it shows faults less clearly."
)
ORDER = option(
    None, "Order of the readings: the paper's (default), or with fewer moves of the gauge."
)
APPLIED = option(
    "DX DY DZ",
    "What was added to the controller's offsets between the two sessions, mm. Default: what"
    " the sessions or the machine file record.",
)
LIMIT = option(
    "MM", "Largest permitted deviation of any difference: pass, fail or undecided.", min=1e-4
)
RULE_OUT = option("CAUSE", "A fault that you looked for and did not find; may be given repeatedly.")
OUTPUT = option("FILE", "File to write. An existing file is never overwritten.", "--output", "-o")
HTML = option("FILE", "Write one HTML page that needs no other files; - is standard output.")
MARKDOWN = option("FILE", "Write Markdown; - is standard output.")
OVERWRITE = flag("--overwrite", "Replace a page that orthocal wrote before.")
DETAILS = flag("--details", "Show everything. Default: one screen.")
JSON = flag("--json", "Print JSON, one object per line.")


def asked_session(
    protocol: Protocol, design: Design, cycles: Count, order: Order, gauges: Count
) -> dict[str, object]:
    """Fields of a `GuidedSession` that options give. Raises UsageError: two exclude each other."""
    from orthoglide_cal.planning import steps

    if design and protocol:
        raise UsageError("--design and --protocol exclude each other.", "Leave out --protocol.")
    name = "best-design" if design else protocol and f"{protocol}-posture"
    asked = {
        "protocol": name and steps.MeasuringProtocol(name),
        "cycles": cycles,
        "order": order and steps.Order(order),
        "stands": gauges,
    }
    return {field: value for field, value in asked.items() if value is not None}


def agreement(yes: bool, reason: str) -> Callable[[str], bool]:
    """Ask at the terminal, unless `yes`. Raises UsageError, with `reason`, without a terminal."""
    if not yes and not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise UsageError(reason, "In a script, give --yes.")

    def agrees(question: str) -> bool:
        asked = wrapped(f"{question} y/n", shutil.get_terminal_size().columns - 4)
        ask = partial(typer.prompt, asked, "n", show_default=False, prompt_suffix=" > ")
        while not yes and (word := str(ask(err=True)).strip().lower()) not in ("y", "yes"):
            if word in ("n", "no"):
                return False
            tell("Type y or n.")
        return True

    return agrees


def for_each(files: Sequence[str], judge: Callable[[str], int], *, as_json: bool = False) -> int:
    """Judge each file alone, in order, and return the worst exit code; errors are told in place."""
    worst = 0
    # What is loaded stays; to look through it again for each file costs a tenth.
    gc.freeze()
    for path in files:
        try:
            worst = max(worst, judge(path))
        except OrthocalError as error:
            worst = max(worst, error.exit_code)
            tell_error(error, path, as_json)
    return worst


def read_input(
    path: str,
    machine_file: Path | None = None,
    data: Data = None,
    rule_out: Sequence[str] | None = None,
) -> Input:
    """Read what was measured at `path` ("-": standard input), judged by the machine of --machine.

    `rule_out` names causes that were looked for and are not there. Raises UsageError for others.
    """
    from orthoglide_cal.causes import CAUSES
    from orthoglide_cal.estimation.arms import free_arms
    from orthoglide_cal.files.input import read_input as read

    for id in rule_out or ():
        if id not in CAUSES:
            raise UsageError(f"There is no cause {id!r}.", f"Choose one of {', '.join(CAUSES)}.")
    given = free_arms(read(path, known_machine(machine_file), usual_machine, data))
    require_printer(given.measured.source, data)
    keeper = None
    with suppress(OrthocalError):  # nothing can be recorded; what was measured stands for itself
        keeper = own_machine_file(machine_file)
    ruled_out = tuple(sorted(set(rule_out or ())))

    def completed(one: Input) -> Input:
        """The input with where it is recorded, what its owner wrote, and what was ruled out."""
        model = replace(one.model, ruled_out=ruled_out) if ruled_out else one.model
        # The machine of many files stays one: what is worked out of it is theirs, too.
        if keeper and keeper.model.machine is not model.machine:
            model = replace(model, machine=model.machine.with_papers(keeper.model.machine))
        return replace(one, keeper=keeper, model=model, machine_file=machine_file)

    return replace(completed(given), others=tuple(map(completed, given.others)))


def judged(given: Input, **how: Any) -> Case:
    """The answer to an input, with arguments of `answer_to`; shows what it works on."""
    from orthoglide_cal.report.case import Case
    from orthoglide_cal.results.making import answer_to

    with working(given.measured.source.path):
        return Case(given, answer_to(given, **how))


def require_printer(source: Source, data: Data) -> None:
    """Refuse --data for a file that stores one measurement only. Raises UsageError."""
    if data is not None and source.excerpt is None:
        fault = f"--data is for a printer's file; {file_words(source.path)} is not one."
        raise UsageError(fault, "Leave it out.")


@cache
def chosen_machine(machine_file: Path | None) -> StoredMachine | None:
    """The machine file of --machine, else that of this folder; None if there is neither."""
    from orthoglide_cal.files.input import machine_in_folder
    from orthoglide_cal.files.machine_file import read_machine_file

    path = machine_file or machine_in_folder(Path())
    return read_machine_file(path) if path else None


@cache
def own_machine_file(machine_file: Path | None) -> StoredMachine:
    """The chosen machine file. Raises UsageError: there is none in which to record anything."""
    from orthoglide_cal.files.machine_file import shipped_folder

    if str(machine_file) == "-":
        raise UsageError("Nothing can be recorded in standard input.", "Name a machine file.")
    file = chosen_machine(machine_file)
    if file is None:
        fault = "There is no machine file in this folder to record the offsets in."
        raise UsageError(fault, "Name it with --machine, or make one: orthocal machine new")
    if Path(file.document.path).resolve().parent == shipped_folder().resolve():
        fault = f"{file.document.path} comes with the program and is never changed."
        raise UsageError(fault, "Make one for your machine: orthocal machine new")
    return file


@cache
def known_machine(machine_file: Path | None) -> Model | PrinterFile | None:
    """The machine of --machine, or the settings of a printer's firmware; None if not given."""
    from orthoglide_cal.files.input import printer_settings

    if machine_file is None:
        return None
    settings = printer_settings(machine_file) if str(machine_file) != "-" else None
    return settings or usual_machine(machine_file)


@cache
def usual_machine(machine_file: Path | None = None) -> Model:
    """The chosen machine, else the prototype; says once which one it is if it was not given."""
    from orthoglide_cal.files.machine_file import default_machine

    file = chosen_machine(machine_file)
    if file is not None and machine_file is None:
        tell(f"The machine is that of {file.document.path}, the machine file in this folder.")
    elif file is None and sys.stderr.isatty():
        # A script that has always worked with the prototype needs no reminder.
        tell(
            "No machine file is named, and this folder has none: the numbers of the paper's"
            " prototype are used. Make a file for your machine: orthocal machine new"
        )
    return file.model if file else default_machine()


def forget() -> None:
    """Forget the machine files that were read: every command reads its own."""
    for known in (chosen_machine, own_machine_file, known_machine, usual_machine):
        known.cache_clear()


def deliver(
    document: Document,
    *,
    as_json: bool = False,
    html: Path | None = None,
    markdown: Path | None = None,
    overwrite: bool = False,
    details: bool = True,
) -> None:
    """Show a document on standard output, as text or as JSON, or write the files asked for.

    Without `details` one screen. Raises UsageError: a file exists that this may not replace.
    """
    if as_json:
        if html or markdown:
            fault = "--json cannot be combined with a page."
            raise UsageError(fault, "Leave out --html and --markdown.")
        put(json_line(document.data()))
        return
    if not (html or markdown):
        from orthoglide_cal.report.terminal import terminal

        screen, make = console(), None if details else document.screen
        screen.print(terminal((make or document.page)(), screen.width), soft_wrap=True)
        return
    from orthoglide_cal.report.document import MARK
    from orthoglide_cal.report.html import html as as_html
    from orthoglide_cal.report.markdown import markdown as as_markdown

    page = document.page()
    for path, render in ((html, as_html), (markdown, as_markdown)):
        if path is None:
            continue
        if overwrite and path.is_file() and not path.read_bytes().endswith(MARK.encode()):
            fault = f"{path} is not a page that orthocal wrote: it is not replaced."
            raise UsageError(fault, "Name another file.")
        try:
            put(render(page), path, f"{page.name} written to {path}", overwrite)
        except UsageError as error:
            raise UsageError(error.what, "Name another file, or replace it: --overwrite") from error


def put(text: str, target: File = None, message: str = "", overwrite: bool = False) -> None:
    """Write a file as `write_text` does, and tell people; "-", or none: show the text."""
    if target is None or str(target) == "-":
        print(text, end="", flush=True)
        return
    from orthoglide_cal.files.text import write_text

    write_text(target, text, overwrite=overwrite)
    tell(message)


def json_line(value: Mapping[str, object]) -> str:
    """One JSON object on one line; NaN is refused."""
    import json

    text = json.dumps(value, allow_nan=False, ensure_ascii=False, check_circular=False)
    return f"{text}\n"


def console(*, stderr: bool = False) -> Console:
    """For results, on standard output; or for messages and progress, on standard error."""
    from rich.console import Console

    class Output(Console):
        """Leaves a closed pipe to the program, where rich would exit with code 1."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    return Output(
        stderr=stderr,
        color_system=None if os.environ.get("NO_COLOR") else "auto",
        highlight=False,
        markup=False,
        emoji=False,
    )


@contextmanager
def working(task: str) -> Iterator[None]:
    """Show on a terminal's standard error what is being worked on, from `SLOW_S` on."""
    if not sys.stderr.isatty():
        yield
        return
    from rich import text

    # As text, not as markup: a file may be called a[/b].yaml.
    status = console(stderr=True).status(text.Text(visible(f"Calculating: {task} …")))
    timer = threading.Timer(SLOW_S, status.start)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        status.stop()


def tell(message: str) -> None:
    """A message on standard error; what file names and the like hold is shown, never obeyed."""
    shown = visible_lines(message)
    if sys.stderr.isatty():
        shown = wrapped(shown, shutil.get_terminal_size().columns)
    print(shown, file=sys.stderr)


def tell_error(error: Exception, path: str | None = None, as_json: bool = False) -> None:
    """An error, and its input: as JSON in place of a result, or else on standard error."""
    if as_json:
        put(json_line({"input": {"path": path} if path else None, "error": str(error)}))
        return
    named = isinstance(error, InputError) and error.file
    tell(f"{file_words(path)}: {error}" if path and not named else str(error))


def leave_closed(*streams: TextIO) -> None:
    """Stop writing to streams whose reader has gone (`| head`), or Python complains at its end."""
    for stream in streams:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
