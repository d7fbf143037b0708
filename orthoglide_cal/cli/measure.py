"""`orthocal measure`: a guided session, from the first set-up to the offsets."""

import errno
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import Count, File, Number, Text, Texts, argument, flag, option
from orthoglide_cal.errors import UnusableResultError, UsageError, command, visible, visible_lines
from orthoglide_cal.words import Unit

if TYPE_CHECKING:
    from orthoglide_cal.session.asking import Asker, Show
    from orthoglide_cal.session.dialogue import Dialogue

Guided = TypeVar("Guided", bound="Dialogue")


def measure(
    session: File = argument(
        "SESSION.yaml", "Session file to write. Default: session.yaml, or the next free name."
    ),
    resume: bool = flag("--resume", "Continue an unfinished session at its next reading."),
    discard: bool = flag(
        "--discard", "Discard an unfinished session; its file is kept as NAME.discarded."
    ),
    protocol: common.Protocol = common.PROTOCOL,
    design: common.Design = common.DESIGN,
    then: Text = option(
        "FILE",
        "Continue these readings: measure what is recommended next (orthocal plan FILE), and"
        " write a session that holds both.",
    ),
    choice: Count = option("N", "With --then: number of the recommendation. Default: 1.", min=1),
    cycles: Count = common.CYCLES,
    order: common.Order = common.ORDER,
    gauges: Count = common.GAUGES,
    gauge: Texts = option(
        "SOURCE",
        "Where readings come from: typed (also keyboard-wedge gauges), simulated, or"
        " FORMAT:PORT[@BAUD][#CHANNELS], such as sylvac:/dev/ttyUSB0. Give it twice for two"
        " ports. Formats: cdi, mahr, mitutoyo, mux, plain, sylvac, uwave.",
    ),
    follow: Text = option(
        "CONTROLLER",
        "linuxcnc[:HOST[:PORT]]: before each reading wait until the machine stands at the"
        " posture. Needs linuxcncrsh. The machine is never moved.",
    ),
    unit: Unit = option(
        None, "Unit of readings typed without a unit. Default: mm.", default=Unit.MM
    ),
    until: Number = option(
        "MM", "End as soon as the U (95 %) of every offset is at most this.", min=1e-4
    ),
    seed: Count = option(
        "N", "Whole number; the same one gives the same simulated machine.", min=0
    ),
    operator: Text = option("NAME", "Your name."),
    temperature: Number = option("C", "Temperature of the room, degrees Celsius."),
    gauge_id: Texts = option("ID", "Identity of the gauge. Give it again for the second gauge."),
    certificate: Texts = option(
        "NO", "Calibration certificate of the gauge. Give it again for the second."
    ),
    machine: File = common.MACHINE,
    offsets_active: common.Offsets = option(
        "DX DY DZ",
        "Joint offsets that the controller holds now, mm. Default: you are asked, and the"
        " machine file's are proposed.",
    ),
    yes: bool = flag(
        "--yes", "Answer yes to the questions before the first reading, and to --discard."
    ),
    json: bool = common.JSON,
) -> int:
    """Measure, guided step by step. Every reading is checked and saved at once."""
    from orthoglide_cal.report.documents.answer import solution_document
    from orthoglide_cal.report.sentences import sentence
    from orthoglide_cal.session.dialogue import Request, open_session, set_aside
    from orthoglide_cal.session.events import GaugeLabel

    if discard:
        agrees = common.agreement(yes, "--discard asks before it gives a session up.")
        kept = set_aside(session, Path(), agrees)
        common.tell(f"Given up; kept as {kept}." if kept else "Nothing was changed.")
        return 0
    if len(certificate or ()) > len(gauge_id or ()):
        fault = "There are more --certificate than --gauge-id."
        raise UsageError(fault, "Give the gauge's id with it.")
    labels = zip_longest(gauge_id or (), certificate or (), fillvalue="")
    request = Request(
        path=session,
        resume=resume,
        agreed=yes,
        offsets_mm=offsets_active,
        model=common.usual_machine(machine) if machine else None,
        otherwise=common.usual_machine,
        keeper=common.chosen_machine(machine) if then else None,
        following=then,
        choice=choice,
        session=common.asked_session(protocol, design, cycles, order, gauges),
        source=tuple(gauge or ()),
        follow=follow,
        seed=seed,
        unit=unit,
        until_mm=until,
        operator=visible(operator or ""),
        temperature_c=temperature,
        gauges=tuple(GaugeLabel(id=visible(id), certificate=visible(no)) for id, no in labels),
        says=sentence,
    )
    with guided(partial(open_session, request), "measure", json) as dialogue:
        dialogue.publish()
        case = common.judged(common.read_input(str(dialogue.path)), details=json)
        common.deliver(solution_document(case), as_json=json, details=False)
        dialogue.reveal()
        return 0 if case.answer.release.usable else UnusableResultError.exit_code


@contextmanager
def guided(
    begin: Callable[["Asker", ExitStack], Guided],
    verb: str,
    as_json: bool,
    machine: File = None,
    options: str = "",
) -> Iterator[Guided]:
    """Lead through what is begun at a keyboard, and give it once it has ended.

    Whatever interrupts it, the exit code is 130.
    """
    from orthoglide_cal.session.asking import Asker, Keyboard
    from orthoglide_cal.session.dialogue import Quit

    names = ("SIGTERM", "SIGHUP", "SIGBREAK")
    caught = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, signal.default_int_handler) for number in caught}
    message = again = ""
    try:
        with ExitStack() as opened:
            keyboard = Keyboard(sys.stderr if as_json else sys.stdout)
            opened.callback(keyboard.close)
            dialogue = begin(Asker(keyboard, _display(as_json)), opened)
            path, options = str(dialogue.path), f"{options} --resume".strip()
            again = command(verb, path, machine=machine, options=options)
            dialogue.greet()
            dialogue.run()
            keyboard.close()  # before the answer is shown
            yield dialogue
        return
    except (Quit, EOFError, KeyboardInterrupt, BrokenPipeError) as reason:
        message = "\nNo session was started."
        if again:
            saved = "Saved." if isinstance(reason, Quit) else "\nInterrupted; everything is saved."
            message = f"{saved} Continue with:\n  {again}"
    except OSError as error:
        if error.errno != errno.EIO:  # the terminal was closed
            raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    try:
        if message:
            common.tell(message)
        sys.stdout.flush()
    except OSError:
        common.leave_closed(sys.stdout, sys.stderr)
    raise typer.Exit(common.INTERRUPTED)


def _display(as_json: bool) -> "Show":
    """Shows a session on standard output, or error if that is for JSON; what is ASIDE on error."""
    from orthoglide_cal.session.asking import Style

    aside = common.console(stderr=True)
    console = aside if as_json else common.console()

    def show(text: str, style: Style = Style.PLAIN, end: str = "\n") -> None:
        # Lines are ready as they are: rich would spend more time on them than all checks together.
        shown = visible_lines(text)
        if style is Style.ABOVE:
            moves = console.is_terminal and not console.is_dumb_terminal
            shown = f"\x1b[{style}{shown}" if moves else shown
        elif shown and style and console.color_system:
            shown = f"\x1b[{style}m{shown}\x1b[0m"
        file = aside.file if style is Style.ASIDE else console.file
        file.write(shown + end)
        file.flush()

    return show
