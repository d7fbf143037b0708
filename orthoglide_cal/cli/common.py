"""What the commands share: options, input, output streams, errors to exit codes.

Heavy modules are imported inside the functions that need them, so that `--help` stays fast.
"""

from __future__ import annotations

import functools
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from orthoglide_cal.errors import InputError, OrthocalError

if TYPE_CHECKING:
    from rich.console import Console

    from orthoglide_cal.machine import Machine
    from orthoglide_cal.measured import Measured


def _switch_colour_off(chosen: bool) -> bool:
    # The environment is where rich and every child process look for it.
    if chosen:
        os.environ["NO_COLOR"] = "1"
    return chosen


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
    typer.Option(
        "--machine",
        metavar="FILE",
        help="Machine file; without it the session's own machine, or the prototype.",
        show_default=False,
    ),
]
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


def read_input(path: str, machine_file: Path | None) -> tuple[Measured, Machine]:
    """The measured data at `path` ("-": standard input) and the machine to judge it by."""
    from orthoglide_cal import data

    return data.read_input(path, _read_machine(machine_file) if machine_file else None)


@functools.cache
def _read_machine(machine_file: Path) -> Machine:
    """One machine file judges many inputs: it is read once."""
    from orthoglide_cal import data

    return data.read_machine(machine_file)


def print_json(value: Mapping[str, Any]) -> None:
    """One JSON object on one line of standard output; NaN is refused."""
    print(json.dumps(value, allow_nan=False, ensure_ascii=False), flush=True)


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
    """A message on standard error."""
    print(message, file=sys.stderr)


def tell_error(error: OrthocalError, path: str = "") -> None:
    """An error on standard error, with the input's name in front unless the error has it."""
    named = isinstance(error, InputError) and error.file
    place = "standard input" if path == "-" else path
    print(f"{place}: {error}" if place and not named else str(error), file=sys.stderr)


def leave_closed_pipe() -> None:
    """Standard output was closed by its reader (`| head`): stop writing without a complaint."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
