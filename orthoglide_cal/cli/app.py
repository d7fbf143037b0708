"""The `orthocal` program: its commands, and how errors become exit codes."""

import atexit
import codecs
import errno
import gc
import io
import os
import pkgutil
import sys
from contextlib import suppress
from typing import Any

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException
from typer.main import get_command

from orthoglide_cal import __version__
from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import INTERRUPTED, PlainCommand, flag, leave_closed
from orthoglide_cal.cli.start import start
from orthoglide_cal.errors import InputError, OrthocalError, UsageError

_ASCII = {  # for terminals that have no other signs
    "−": "-", "–": "-", "±": "+/-", "→": "->", "←": "<-", "µ": "u", "σ": "s", "·": ".", "✔": "+",
}  # fmt: skip
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

_COMMANDS = (  # each in the file of its name
    "measure", "solve", "diagnose", "plan", "apply", "adjust", "verify", "history", "report",
    "export", "simulate", "validate", "paper", "template", "guide", "machine",
)  # fmt: skip


class _Commands(TyperGroup):
    """Loads only the command that is asked for; errors end it with their own exit code."""

    def __init__(self, **settings: Any) -> None:
        # Their names are listed, and suggested for what is no command.
        super().__init__(**{**settings, "commands": dict.fromkeys(_COMMANDS)})

    def get_command(self, ctx: object, cmd_name: str) -> Any:
        if cmd_name not in _COMMANDS:
            return None
        command = pkgutil.resolve_name(f"{__package__}.{cmd_name}:{cmd_name}")
        if not isinstance(command, typer.Typer):
            alone = typer.Typer(rich_markup_mode=None, add_completion=False)
            alone.command(cls=PlainCommand)(command)
            command = alone
        return get_command(command)

    def invoke(self, ctx: Any) -> Any:
        common.forget()
        as_json = "--json" in ctx.args
        try:
            return super().invoke(ctx)
        except OrthocalError as error:
            path = ctx.obj or getattr(error, "file", None)
            path = path[0] if isinstance(path, list) else path
            common.tell_error(error, str(path) if path and as_json else None, as_json)
            raise typer.Exit(error.exit_code) from error
        except TyperException as error:
            # What the library refuses, in its words, is told as all else is.
            error.message = error.message.removeprefix("Value error, ")
            help = " ".join(filter(None, ("orthocal", ctx.invoked_subcommand, "--help")))
            common.tell_error(UsageError(f"{error.format_message()}\nHelp: {help}"), None, as_json)
            raise typer.Exit(UsageError.exit_code) from error
        except BrokenPipeError:
            leave_closed(sys.stdout)
            raise typer.Exit from None
        except typer.Abort:
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    name="orthocal",
    cls=_Commands,
    help="Calibrate and diagnose an Orthoglide-type machine with a dial indicator.",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback(invoke_without_command=True)
def _orthocal(
    context: typer.Context,
    version: bool = flag("--version", "Show the version."),
    no_colour: bool = flag("--no-color", "No colours; NO_COLOR does the same."),
) -> None:
    if no_colour:
        os.environ["NO_COLOR"] = "1"
    if version:
        print(f"orthocal {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        start()


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    """Replacement where a terminal has no such characters: never a "?" for a sign."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    missing = error.object[error.start : error.end]
    return "".join(_ASCII.get(sign, "?") for sign in missing), error.end


def run() -> None:
    """Run the command that was typed."""
    # All matrices here are small: threads of the linear algebra only get in each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What a command loads is no garbage: looking for some takes a tenth of its time.
    gc.set_threshold(100_000)
    # Keep free memory: malloc of Linux keeps twice the largest block that was ever freed.
    bytes(1 << 24)
    atexit.register(gc.freeze)
    codecs.register_error(_in_ascii.__name__, _in_ascii)
    # Closed by the shell (`>&-`): nobody reads it.
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_in_ascii.__name__)
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        leave_closed(sys.stdout)
    except OSError as error:
        if error.errno not in _FULL:
            raise
        leave_closed(sys.stdout)
        with suppress(OSError):
            print(f"Standard output cannot be written: {error.strerror}.", file=sys.stderr)
        sys.exit(InputError.exit_code)
