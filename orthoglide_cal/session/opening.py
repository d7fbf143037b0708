"""Beginning a session, and going on with one only if nothing essential has changed.

Also what is measured next where earlier readings are continued, and where the session's file is.
"""

import os
import re
import secrets
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from operator import attrgetter
from pathlib import Path

import numpy as np

from orthoglide_cal.errors import InputError, OrthocalError, UsageError, command, visible
from orthoglide_cal.files import machine_file
from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.readings import implausible_temperatures
from orthoglide_cal.files.text import free_path, read_document
from orthoglide_cal.inference import NextMeasurement, diagnose
from orthoglide_cal.model.machine import LARGEST_OFFSET_MM
from orthoglide_cal.model.model import Model
from orthoglide_cal.model.orthoglide import plan_of
from orthoglide_cal.model.readings import GaugePlan
from orthoglide_cal.planning.plan import rank_measurements
from orthoglide_cal.planning.steps import (
    MOST_CYCLES,
    GuidedSession,
    MeasuringProtocol,
    SessionStep,
    require_on_bar,
    steps_of,
)
from orthoglide_cal.schema import Reason, parse_number
from orthoglide_cal.session import events, wording
from orthoglide_cal.session.asking import Asker, Style
from orthoglide_cal.session.dialogue import Dialogue
from orthoglide_cal.session.gauges import SerialGauge, SimulatedGauge, Standing
from orthoglide_cal.session.journal import Journal, create, decode
from orthoglide_cal.session.readings import PriorReadings, Setting
from orthoglide_cal.words import Unit, counted

TYPED, SIMULATED = "typed", "simulated"
JOURNAL = ".journal"
_LONGEST = 200  # bytes; file systems take 255, also of the temporary file's name


@dataclass(frozen=True)
class Request:
    """The operator's wishes on the command line; None where it says nothing.

    What stands in `events.Opened` too must not change while a session lasts.
    """

    path: Path | None = None  # of the session file
    resume: bool = False  # go on with an unfinished session
    agreed: bool = False  # to what is asked before the first reading
    offsets_mm: tuple[float, float, float] | None = None  # that the controller holds now
    model: Model | None = None
    otherwise: Callable[[], Model] = machine_file.default_machine  # where no file names one
    keeper: machine_file.StoredMachine | None = None  # of what is entered, where data continue
    following: str | None = None  # path of the data that the session continues
    choice: int | None = None  # which recommendation is carried out, from 1
    session: Mapping[str, object] = field(default_factory=dict)  # given fields of `GuidedSession`
    source: tuple[str, ...] = ()
    follow: str | None = None  # address of the controller whose machine is waited for
    seed: int | None = None
    unit: Unit = Unit.MM  # of readings without one
    until_mm: float | None = None  # end once every offset is known this well
    operator: str = ""
    temperature_c: float | None = None
    gauges: tuple[events.GaugeLabel, ...] = ()
    says: Callable[[Reason], str] = attrgetter("code")  # words a reason


def clock() -> str:
    """The time of day, ISO 8601 with the offset from UTC, to the millisecond."""
    return datetime.now().astimezone().isoformat(timespec="milliseconds")


def open_session(request: Request, asker: Asker, opened: ExitStack) -> Dialogue:
    """Begin a session, or go on with one; what is `opened` is closed with it.

    Raises UsageError: what is asked for does not go together, or with what is there; InputError,
    GaugeLost: a file or the gauge cannot be used; EOFError, KeyboardInterrupt: nobody answers.
    """
    _check_options(request)
    path = session_file(request.path, Path(), request.resume)
    # What is missing leaves no file behind.
    standing = opened.enter_context(closing(Standing(request.follow))) if request.follow else None
    asker.gauge = serial_gauge(request.source, opened)
    target = path.with_suffix(JOURNAL)
    if not request.resume:
        create(target, *_first_records(request, asker))
    journal = Journal.resume(target, opened)
    state = events.replay(journal.events)
    setting = setting_in(journal, state)
    source = request.source or state.source
    if request.resume:
        _refuse_changes(state.opened, setting.held, request)
        asker.gauge = asker.gauge or serial_gauge(source, opened)
        asker.say(wording.machine(setting.held, state.opened.seed is not None))
        if setting.following:
            asker.say(setting.following.words, Style.TITLE)
    if source == (SIMULATED,):
        asker.gauge = SimulatedGauge(setting, state.opened.seed or 0)
    dialogue = Dialogue(
        path, journal, setting, asker, clock, request.unit, request.until_mm, standing,
        agreed=request.agreed,
    )  # fmt: skip
    if request.source and request.source != state.source and state.ended is None:
        dialogue.write(events.Reopened(at=clock(), source=request.source))
    return dialogue


def _check_options(request: Request) -> None:
    """Raises UsageError if what is asked for does not go together."""
    path, following = request.path, request.following
    for doubt in implausible_temperatures([request.temperature_c]):
        raise UsageError(request.says(doubt), "Correct it, or leave it out.")
    if following is None:
        if request.choice is not None:
            raise UsageError("--choice needs a recommendation.", "Name its data: --then FILE")
        return
    if path and session_path(path).resolve() == Path(following).resolve():
        fault = f"{following} is never changed: it cannot be the new session, too."
        raise UsageError(fault, "Name another file for the session that will hold both.")
    options = {
        "--resume": request.resume,
        "--protocol or --design": request.session.get("protocol"),
        "--cycles": request.session.get("cycles"),
        "--order": request.session.get("order"),
        "--until": request.until_mm,
    }
    for name in (name for name, value in options.items() if value):
        fault = f"--then and {name} do not go together."
        raise UsageError(fault, "Leave out one of them: what is read follows from what was begun.")


def _first_records(request: Request, asker: Asker) -> list[events.Event]:
    """The first records, once the operator has agreed to the machine and its active offsets.

    And to the measurement that is recommended, if one is to be carried out. Nobody is asked who
    has agreed already, or has no terminal. What the command line leaves open is standard.
    """
    first, following, change = None, None, ""
    session = GuidedSession().changed(**request.session)
    if request.following is None:
        model = request.model or request.otherwise()
        model.machine.check_guided()
        if session.protocol is MeasuringProtocol.SINGLE:
            session = session.changed(stands=1)
        steps = session.steps(model.machine)
        plan = plan_of([step.cell for step in steps])
    else:
        first, options, model = _recommended(request.following, request)
    model = _holding(model, request.offsets_mm)
    source, seed = _source(request, first)
    confirmed: Model | None = None
    while confirmed is not model:  # what was typed is shown, and asked once more
        model = confirmed or model
        if first:
            offsets = model.machine.active
            plan, following, change = planned_next(first, options, request, offsets)
        careful = require_on_bar(plan, model.machine)
        asker.say(wording.machine(model, seed is not None))
        doubts = map(request.says, model.machine.instrument.implausible().values())
        for doubt in filter(None, (careful and str(careful), *doubts, change)):
            asker.say(doubt, Style.BAD)
        if following:
            asker.say(following.words, Style.TITLE)
        silent = request.agreed or not asker.keyboard.live
        confirmed = model if silent else _confirmed(model, first is not None, asker)
    if first:
        # What others are joined to keeps the machine as it was for the first of them.
        model = first.model
        steps = steps_of(plan, model.machine, session.order, session.stands)
        most = max(step.cycle for step in steps)
        session = session.changed(cycles=min(most, MOST_CYCLES))
    version = 2 if first or session.protocol is MeasuringProtocol.BEST else 1
    opened = events.Opened(
        **dict(session), at=clock(), version=version, machine=machine_file.machine_text(model),
        source=source, seed=seed, operator=request.operator,
        temperature_c=request.temperature_c, gauges=request.gauges,
    )  # fmt: skip
    readings = tuple(step.cell for step in steps)
    planned = events.Planned(at=opened.at, readings=readings, following=following)
    return [opened, planned] if version == 2 else [opened]


def _confirmed(model: Model, also: bool, asker: Asker) -> Model:
    """The machine once it is agreed to, or with the offsets that are typed instead.

    `also`: to measure what is recommended. Raises UsageError: it is another machine; EOFError.
    """
    question = (
        "Is it this machine, with these offsets in its controller"
        f"{', and shall this be measured now' * also}? Return: yes.  n: no."
        "  Other offsets: type the three, in mm."
    )
    asker.say(question, Style.QUESTION)
    while True:
        answer = asker.ask("Return, n, or the three offsets > ")
        match answer.lower() if isinstance(answer, str) else "?":
            case "" | "y" | "yes":
                return model
            case "q" | "quit":
                raise EOFError
            case "n" | "no":
                remedy = "Name the file of your machine, --machine FILE, or make one:"
                raise UsageError("Nothing was begun.", f"{remedy} orthocal machine new")
            case "?" | "help":
                asker.say(question, Style.QUESTION)
            case text:
                try:
                    parts = text.replace(";", " ").split()
                    offsets = tuple(parse_number(part, decimal_comma=True) for part in parts)
                    return _holding(model, offsets)
                except OrthocalError as error:
                    asker.say(str(error), Style.BAD)


def planned_next(
    first: PriorReadings,
    options: tuple[NextMeasurement, ...],
    request: Request,
    offsets_mm: Sequence[float],
) -> tuple[GaugePlan, events.Following, str]:
    """Plan what is recommended next, best first, with these offsets [mm] in the controller.

    The last is what was entered since the first readings, in a sentence. Raises UsageError.
    """
    x, y, z = np.subtract(offsets_mm, first.model.machine.active).round(9).tolist()
    change = np.subtract((x, y, z), first.left_entered)
    # To act they were homed for, and that has pushed stands that were still there.
    moved = bool(change.round(6).any())
    number = request.choice or next(
        k for k, option in enumerate(options, 1) if not (moved and option.continues)
    )
    option = options[number - 1]
    plan = GaugePlan.require(option.plan)
    if moved and option.continues:
        raise UsageError(
            "The offsets in the controller were changed since the last reading: that"
            " measurement needs the machine and the stands as they were.",
            "Leave out --choice for one with the stands set up again.",
        )
    if option.continues and request.session.get("stands") == 1 and len(set(plan.series)) > 1:
        fault = "That measurement needs the two gauges where they are."
        raise UsageError(fault, "Use two gauges, or take another recommendation: --choice 2")
    following = events.Following(
        data=first.data, what=request.says(option.what), minutes=option.minutes,
        continues=option.continues, entered=(x, y, z),
    )  # fmt: skip
    plan = replace(plan, entered=(plan.entered + change).round(9))
    if not moved:
        return plan, following, ""
    changed = (
        f"Since {visible(first.path)} was measured, the offsets in the controller were changed"
        f" by {wording.by_axis(change, '+.4g')} mm: the new readings are written with that"
        " difference."
    )
    return plan, following, changed


def _recommended(
    path: str, request: Request
) -> tuple[PriorReadings, tuple[NextMeasurement, ...], Model]:
    """Rank what to measure next, given the readings in a file, and on which machine."""
    keeper, choice = request.keeper, request.choice
    if path == "-":
        raise UsageError("--then needs a file; standard input is the keyboard.", "Name the file.")
    data = read_document(path)
    given = read_input(data, request.model, request.otherwise)
    given.model.machine.check_guided()
    if names := machine_file.differing(given.recorded or given.model, given.model):
        raise UsageError(
            f"{path} was measured on another machine than that of --machine: they differ in"
            f" {', '.join(names)}.",
            "Leave out --machine to use the machine of the session.",
        )
    first = PriorReadings(data, given)
    if not first.plan.fixed:
        raise UsageError(
            f"{path} was measured with the single-posture protocol. Further readings need fixed"
            " gauges; readings of both kinds cannot be joined.",
            "Measure a separate session: orthocal measure",
        )
    options = rank_measurements(diagnose(first.readings, first.model))
    if choice is not None and choice > len(options):
        fault = f"There is no recommendation {choice} for {path}: there are {len(options)}."
        raise UsageError(fault, "Leave out --choice for the best one.")
    offsets = first.model.machine.active + first.left_entered
    if keeper is not None and not machine_file.differing(keeper.model, first.model):
        offsets = np.array(keeper.model.machine.active)
    return first, options, first.model.holding(tuple(offsets.round(9).tolist()))


def _holding(model: Model, offsets_mm: tuple[float, ...] | None) -> Model:
    """The machine with other offsets in its controller. Raises UsageError."""
    if offsets_mm is None:
        return model
    most = min(model.machine.travel_mm, LARGEST_OFFSET_MM)
    if len(offsets_mm) != 3 or not all(abs(value) < most for value in offsets_mm):
        raise UsageError(
            "These are not three joint offsets.",
            f"Give X, Y and Z in mm, none beyond the travel of {most:g} mm: 0.412 -0.3 0",
        )
    return model.holding(offsets_mm)


def _source(request: Request, first: PriorReadings | None) -> tuple[tuple[str, ...], int | None]:
    """Where the readings come from; and the seed of a simulated gauge. Raises UsageError."""
    environment = dict(first.conditions.environment) if first else {}
    drawn = re.fullmatch("[0-9]{1,18}", environment.get("seed", ""))
    # Of the simulated gauge that gave the first readings.
    hidden = int(drawn[0]) if drawn and environment.get("readings_from") == SIMULATED else None
    source = request.source or ((TYPED,) if hidden is None else (SIMULATED,))
    if source != (SIMULATED,):
        if request.seed is not None:
            raise UsageError("A seed belongs to the simulated gauge.", "Add --gauge simulated.")
        return source, None
    if first and (hidden is None or request.seed not in (None, hidden)):
        raise UsageError(
            f"{first.path} was not measured on this simulated machine.",
            f"Leave out --gauge and --seed{': it is measured again' if drawn else ''}.",
        )
    seeds = (hidden, request.seed, secrets.randbelow(1_000_000))
    return source, next(seed for seed in seeds if seed is not None)


def setting_in(
    journal: Journal, state: events.State, steps: tuple[SessionStep, ...] = ()
) -> Setting:
    """Machine, earlier readings, and steps unless they are given. Raises InputError."""
    path, opened, planned = str(journal.path), state.opened, state.planned
    model = machine_file.machine_from_text(opened.machine, path)
    if planned is None:
        steps = opened.session.steps(model.machine)
    elif not steps:
        plan = planned.readings[0].planned(planned.readings)
        steps = steps_of(plan, model.machine, opened.order, opened.stands)
    known = all(1 <= getattr(event, "step", 1) <= len(steps) for event in journal.events)
    if not known or (planned is None) != (opened.version == 1):
        raise InputError(
            "The journal has a step that this session does not have, or another reading for it.",
            "Restore the file from a copy; or move it away and begin again.",
            file=path,
        )
    return Setting(model, steps, planned.following if planned else None)


def serial_gauge(source: Sequence[str], opened: ExitStack) -> SerialGauge | None:
    """Open the serial gauges that --gauge names; None for others. Raises UsageError, GaugeLost."""
    if tuple(source) in ((), (TYPED,), (SIMULATED,)):
        return None
    if TYPED in source or SIMULATED in source or len(source) > 2:
        fault = f"These gauges do not go together: {', '.join(source)}."
        raise UsageError(fault, "Give typed, simulated, or one or two of FORMAT:PORT.")
    gauge = SerialGauge(source)
    for port in gauge.ports:
        opened.callback(port.close)
        port.open()
    return gauge


def _refuse_changes(opened: events.Opened, model: Model, request: Request) -> None:
    """Raises UsageError, naming every difference, if the session asked for is another one."""
    # What the controller held was asked when the session began; the file may say otherwise.
    asked = _holding(request.model or model, request.offsets_mm or model.machine.active)
    one, other = machine_file.machine_values(model), machine_file.machine_values(asked)
    names = {"stands": "gauges side by side"}
    pairs: list[tuple[str, object, object]] = [
        *((names.get(k, k), getattr(opened, k), now) for k, now in request.session.items()),
        ("seed", opened.seed, request.seed),
        *((f"machine, {k}", one.get(k, "none"), other.get(k, "none")) for k in one | other),
    ]
    if request.source and (SIMULATED in request.source) != (SIMULATED in opened.source):
        pairs.append(("gauge", ", ".join(opened.source), ", ".join(request.source)))
    differences = [
        f"{name}: {before} in the session, {now} asked for"
        for name, before, now in pairs
        if now not in (None, before)
    ]
    if differences:
        fault = "This is not the session that was begun. " + "; ".join(differences) + "."
        raise UsageError(fault, "Leave those options out, or begin a new session in another file.")


# ---- its file: `session.yaml` in the end, `session.journal` meanwhile


def session_path(given: Path) -> Path:
    """The session file that is meant by a name, be it that of its journal or without a suffix.

    Raises UsageError where it cannot be the name of a file.
    """
    if given.name in ("", ".."):
        fault = "A session must be a file; this is not one."
        raise UsageError(fault, "Name a file, such as session.yaml, or leave the name out.")
    if len(os.fsencode(given.name)) > _LONGEST:
        raise UsageError("The name of the file is too long.", "Choose a shorter one.")
    if given.suffix == JOURNAL:
        return given.with_suffix(".yaml")
    if given.suffix in (".yaml", ".yml"):
        return given
    return given.with_name(f"{given.name}.yaml")


def session_file(given: Path | None, folder: Path, resume: bool) -> Path:
    """The file of the session to begin or to go on with.

    Without a name it is, in the folder, the first free one of `session.yaml`, `session-2.yaml` …,
    or that of the only unfinished session. Raises UsageError: it exists, or there is an unfinished
    session, unless it is a practice; or, to go on, there is none, or there are several.
    """
    if given is None:
        waiting = unfinished(folder)
        names = ", ".join(path.name for path in waiting)
        if resume:
            if len(waiting) == 1:
                return waiting[0].with_suffix(".yaml")
            several = f"There are {len(waiting)} unfinished sessions here: {names}."
            fault = several if waiting else "There is no unfinished session in this folder."
            raise UsageError(fault, "Name its file: orthocal measure NAME.yaml --resume")
        if not all(map(is_practice, waiting)):  # a practice is no part of the loop
            raise UsageError(
                f"There is an unfinished session here: {names}.",
                "Continue with --resume, or name a file for a new one: orthocal measure NAME.yaml",
            )
        return free_path(folder, "session", ".yaml", JOURNAL)
    path = session_path(given)
    journal = path.with_suffix(JOURNAL)
    if not resume and path.exists():
        raise UsageError(
            f"{path} exists; a session is never overwritten.",
            "Name another file, or continue an unfinished session with --resume.",
        )
    if not resume and journal.exists():
        fault = f"{journal} holds a session that is not finished."
        raise UsageError(fault, f"Continue it: {command('measure', str(path), options='--resume')}")
    return path


def set_aside(given: Path | None, folder: Path, agrees: Callable[[str], bool]) -> str | None:
    """Give up an unfinished session if its operator `agrees`; the name that its journal has then.

    Raises UsageError: there is none, it is finished, or in use; InputError: it cannot be renamed.
    """
    path = session_file(given, folder, resume=True)
    journal, readings = path.with_suffix(JOURNAL), "readings, but is damaged"
    if path.exists() or not journal.exists():
        fault = f"There is no unfinished session {path}: nothing is discarded."
        raise UsageError(fault, "See what is in this folder: orthocal")
    with suppress(InputError), ExitStack() as opened:
        records = Journal.resume(journal, opened).events
        readings = counted(len(events.replay(records).accepted), "reading")
    aside = free_path(path.parent, path.stem, ".discarded")
    fate = f"It will be kept as {aside}\nand cannot be resumed. Give it up?"
    if not agrees(f"{journal} holds {readings}.\n{fate}"):
        return None
    try:
        journal.rename(aside)
    except OSError as error:
        fault = f"{journal} cannot be renamed: {error.strerror}."
        raise InputError(fault, "Check the folder and its permissions.") from error
    return str(aside)


def is_practice(journal: Path) -> bool:
    """True if an unfinished session reads a simulated machine; False if it cannot be read."""
    with suppress(OrthocalError, OSError):
        return events.replay(decode(journal.read_bytes(), journal).events).opened.seed is not None
    return False


def unfinished(folder: Path) -> list[Path]:
    """Journals without a session file, in alphabetical order."""
    journals = folder.glob(f"*{JOURNAL}")
    return sorted(path for path in journals if not path.with_suffix(".yaml").exists())
