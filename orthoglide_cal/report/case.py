"""A result to be shown, and the parts common to all pages: its data and machine, the decision, the
next steps, and the facts about machine, gauges and circumstances, in the words of its kind.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import zip_longest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import command, file_words
from orthoglide_cal.files.input import Input
from orthoglide_cal.inference import Verdict
from orthoglide_cal.model.machine import Machine, Vocabulary
from orthoglide_cal.model.measured import DataKind, Source
from orthoglide_cal.model.model import Cause
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.sentences import cause_words, sentence
from orthoglide_cal.results.answer import (
    RETAKE,
    THEN,
    Answer,
    CheckReading,
    Identity,
    InputFile,
    Validity,
)
from orthoglide_cal.results.application import recording
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    counted,
    decimals_for,
    moment_words,
    plain,
    short,
    signed,
    unit_words,
    with_uncertainty,
)

# Kind of data, or of file → what one entry is, and of what.
_DATA: Mapping[str, tuple[str, str]] = {
    DataKind.READINGS: ("reading", ""),
    "session": ("reading", " of a session"),
    DataKind.SIX: ("difference", ", max − min"),
    DataKind.TWELVE: ("difference", " from the isotropic posture"),
    DataKind.SINGLE: ("difference", ", tool end − joint end"),
}
# What makes a result worthless if it is overlooked: it stands first.
INVALIDATING = ("overdue_gauge", "stale_mesh", "nozzle_lower")
# What the owner of a machine wrote for its reports: who and which; how and with what.
OWNER = ("organisation", "address", "place", "customer", "serial_number")
MEANS = ("method", "traceability", "authorised_by", "gauge_due")
LARGEST_OFFSET = 10.0  # beyond it a length or an angle is no offset
_TAKING_METHODS = ("solve", "report", "export")
_DIAGNOSING = ("solve", "diagnose", "report", "export", "apply")


@dataclass(frozen=True, eq=False)
class Case:
    """An answer with its input."""

    given: Input
    answer: Answer
    options: Mapping[str, object] = field(default_factory=dict)  # further ones of diagnose

    @property
    def source(self) -> Source:
        """The file that the data came from."""
        return self.given.measured.source

    @property
    def machine(self) -> Machine:
        """The machine that they are judged by."""
        return self.given.model.machine

    @property
    def words(self) -> Vocabulary:
        """The words of its kind."""
        return self.machine.vocabulary

    def title_of(self, id: str, parameters: int = 1) -> str:
        """Name of a cause at such a machine; of wrong readings, with a parameter each, how many."""
        if CAUSES[id].hides_reading and parameters > 1:
            return f"{parameters} readings are wrong"
        return cause_words(id, self.machine)["title"]

    def says(self, reason: Reason) -> str:
        """The sentence for a reason, in the words of this kind of machine."""
        return sentence(reason, self.machine)

    def data(self) -> dict[str, object]:
        """The answer as `--json` prints it."""
        return self.answer.model_dump(mode="json", context=self.says)

    @property
    def others(self) -> "tuple[Case, ...]":
        """The other data of the same file with their answers."""
        return tuple(map(Case, self.given.others, self.answer.others))

    @property
    def known(self) -> tuple[Cause, ...]:
        """Lasting causes of the machine: accepted ones, and those that were found."""
        sure = self.answer.causes if self.answer.verdict is Verdict.NAMED else ()
        named = [CAUSES[cause.id] for cause in sure]
        lasting = [cause for cause in named if cause.in_machine and cause.lasting]
        return (*(effect.cause for effect in self.given.model.remaining()), *lasting)

    @property
    def method(self) -> str | None:
        """The method, if another one than the usual was asked for."""
        method = self.answer.method
        return None if method == self.answer.input.kind else method

    def typed(self, verb: str, *options: str, other: str = "") -> str:
        """A command about this input, with what was given for it, more options, another file."""
        excerpt, paths = self.source.excerpt, [self.source.path]
        given = [f"--data {excerpt.data}"] if excerpt and excerpt.data else []
        if verb == "diagnose" and self.source.earlier:
            paths = [*self.source.earlier, *paths]
            given.append("--together")
        if self.method is not None and verb in _TAKING_METHODS:
            given.append(f"--method {self.method}")
        given += filter(None, options)
        if verb in _DIAGNOSING:
            given += [f"--rule-out {id}" for id in self.answer.ruled_out]
        paths += filter(None, [other])
        named = self.options if verb == "diagnose" else {}
        machine = self.given.machine_file
        return command(verb, *paths, machine=machine, options=" ".join(given), **named)

    def remedies(self, *wanted: str) -> Iterator[doc.Line]:
        """Steps instead of entering the parameters, and about causes; with options only these."""
        steps = []
        for remedy in self.answer.release.remedies:
            verb, options, typed = remedy.verb, remedy.options, None
            if verb == "measure" and options != RETAKE:
                typed = self.further(None if options == THEN else options)
            elif verb is not None:
                typed = self.typed(verb, options)
            if not wanted or options in wanted:
                steps.append(doc.step(self.says(remedy.sentence), typed))
        yield from dict.fromkeys(steps)  # two reasons may have one remedy

    @property
    def verify(self) -> str:
        """The command to compare with once the parameters were entered and measured again.

        It holds what was entered where no machine file can tell; the option takes three values.
        """
        unknown = recording(self.given) == "nowhere" and len(self.answer.parameters) == len(AXES)
        digits = self.answer.decimals
        changes = " ".join(plain(size.change(digits), digits) for size in self.answer.parameters)
        return self.typed("verify", f"--applied {changes}" if unknown else "", other="AFTER")

    @property
    def record(self) -> str | None:
        """The command that records what was entered; None where it is recorded, or nowhere kept."""
        return self.typed("apply") if recording(self.given) == "due" else None

    def further(self, session: str | None) -> str | None:
        """The command for a further measurement; a printer has other ways.

        `session` are the options of a session of its own; None: it goes on from these readings.
        """
        if session is not None:
            return command("measure", machine=self.given.machine_file, options=session)
        if not self.words.measure or self.source.path == "-":
            return None
        verb = f"{self.words.measure} --then"
        return command(verb, self.source.path, machine=self.given.machine_file)

    @property
    def for_controllers(self) -> bool:
        """False for what was practised: no line of it is for a controller."""
        return not (self.answer.simulated or self.machine.practice)

    @property
    def table(self) -> str | None:
        """The command for a table that corrects what offsets leave; None where none would."""
        left = "remains" in self.answer.release.codes
        known = any(effect.cause.compensable for effect in self.given.model.accepted)
        wanted = known and left and self.for_controllers
        return self.typed("export", "--format table") if wanted else None


def check_words(check: CheckReading) -> str:
    """The check posture as an instruction, with the number that is expected."""
    moves = f"{with_uncertainty(check.expected_mm, check.expanded_mm)} mm"
    today = f"(today {signed(check.before_mm, decimals_for(check.expanded_mm))})"
    first, second = (position_words(place, 3) for place in (check.first_mm, check.second_mm))
    if check.ends:
        return (
            f"Check: put the gauge on leg {check.leg}, along {check.direction}, at {first}; the"
            f" tool end must read {moves} more than the joint end {today}."
        )
    return (
        f"Check: put the gauge {plain(check.gauge_mm or 0.0, 0)} mm from carriage {check.leg},"
        f" along {check.direction}; drive from {first} to {second}; it must move by {moves}"
        f" {today}."
    )


def size_words(value: float, expanded: float, unit: str) -> str:
    """Value ± U, with the unit; whole numbers have no U, and what is no offset has no "+"."""
    number = with_uncertainty(value, expanded) if expanded else signed(value, 0)
    number = number.removeprefix("+") if abs(value) > LARGEST_OFFSET else number
    return f"{number} {unit_words(unit)}".rstrip()


def sizes_words(sizes: Iterable[tuple[str, float, float, str]]) -> str:
    """Names, values ± U and units; a unit stands once, behind the last that has it.

    >>> sizes_words([("x", 0.5, 0.02, "mm"), ("y", -0.1, 0.02, "mm"), ("angle_a", 1.0, 0.0, "deg")])
    'x +0.500 ± 0.020, y −0.100 ± 0.020 mm, angle_a +1 deg'
    """
    texts, rows = [], [*sizes]
    for (name, value, expanded, unit), later in zip_longest(rows, rows[1:]):
        last = later is None or later[-1] != unit
        texts.append(f"{name} {size_words(value, expanded, unit if last else '')}")
    return ", ".join(texts)


def position_words(tool_mm: Sequence[float], decimals: int) -> str:
    """ "X60 Y0 Z0": a tool position as it is typed."""
    pairs = zip(AXES, tool_mm, strict=False)
    return " ".join(f"{axis.upper()}{short(value, decimals)}" for axis, value in pairs)


def measure_again(given: Input) -> str:
    """The command to measure again: a simulated machine comes back with its seed."""
    seed = dict(given.conditions.environment).get("seed")
    options = f"--gauge simulated --seed {seed}" if seed and seed.isdecimal() else ""
    return command("measure", machine=given.machine_file, options=options)


# --- of which data, of whose machine, for what it holds ----------------------------------------


def data_words(source: Source | None, kind: str, count: int) -> str:
    """Number and kind of the data.

    >>> data_words(None, "six", 6), data_words(None, "session", 1)
    ('6 differences, max − min', '1 reading of a session')
    """
    if source is not None and source.excerpt is not None:
        return source.excerpt.words
    noun, of_what = _DATA[kind]
    return counted(count, noun) + of_what


def input_words(given: Input) -> str:
    """Number and kind of the data of one measurement."""
    return data_words(given.measured.source, given.measured.kind, len(given.measured))


def origin(inputs: Sequence[Input]) -> Iterator[tuple[str, doc.Blank]]:
    """Origin of one measurement, or of before and after: file, number and kind, digest."""
    names = ("Before", "After") if len(inputs) > 1 else ("Input",)
    for name, given in zip(names, inputs, strict=True):
        source = given.measured.source
        yield name, doc.given(f"{file_words(source.path)} ({input_words(given)})")
        yield "SHA-256", doc.code(source.sha256)


def comparison_words(single: bool) -> tuple[str, str]:
    """The kind of differences that are promised, and the meaning of their names."""
    if single:
        return "tool end − joint end", "dz_x+ is along z on leg x at max."
    return "max − min", "dx_y is along x on leg y."


def stated(machine: Machine, names: Sequence[str]) -> tuple[tuple[str, doc.Marked], ...]:
    """Facts that the owner wrote under these names into the machine's file."""
    texts = {name.replace("_", " ").capitalize(): getattr(machine.report, name) for name in names}
    return tuple((name, doc.given(text)) for name, text in texts.items() if text is not None)


def signed_page(
    kind: str,
    machine: Machine,
    identity: Identity,
    inputs: Sequence[tuple[InputFile, Validity]],
    simulated: bool,
) -> doc.Page:
    """The beginning of a numbered page: its subject, and the conditions under which it holds.

    Its `inputs` are one measurement, or before and after; of simulated ones it is no report.
    """
    words = machine.vocabulary
    number = ("Number", doc.code(identity.number))
    issued = ("Issued", moment_words(identity.issued))
    first, *later = (_conditions(*recorded, machine.noted) for recorded in inputs)
    named = ((name.capitalize(), value) for name, value in first.items())
    strip: doc.Block = doc.Facts((*named, ("Software", identity.software)))
    if later:
        strip = doc.Grid(
            ("conditions", "before", "after"),
            [(name, value, later[0][name]) for name, value in first.items()],
            words=(0, 1, 2),
            caption=f"{identity.software}; data with the first digits of SHA-256.",
        )
    return doc.Page(
        kind="Practice report" if simulated else kind,
        title=machine.name,
        number=identity.number,
        facts=doc.Facts((*stated(machine, OWNER), number, issued)),
        sheet=[doc.Section(None, strip)],
        scope="The results relate only to the machine and the instruments named here, as they were"
        f" when measured, and to the {words.positions} and conditions stated. The report is valid"
        " only with all its pages: reproduce it only in full.",
        simulated=simulated,
    )


def reserved(notice: doc.Notice, reservations: Sequence[str]) -> doc.Notice:
    """The verdict with what a reader has to know before relying on it."""
    return replace(notice, lines=(*notice.lines, *map(doc.doubtful, reservations)))


def _conditions(of: InputFile, validity: Validity, noted: Sequence[str]) -> dict[str, doc.Blank]:
    """Those of one measurement: when it was, what is `noted` at such a machine, and the data."""
    gauges: list[doc.Inline] = []
    for gauge in validity.gauges:
        gauges += ["; " if gauges else "", doc.given(gauge.id)]
        if gauge.certificate:
            gauges += [", certificate ", doc.given(gauge.certificate)]
        if gauge.expanded_mm is not None:
            gauges.append(f", U {short(gauge.expanded_mm, 6)} mm")
        due = f"due {gauge.due}" if gauge.due else "due date not given"
        gauges += [", ", doc.doubtful(f"overdue: {due}") if gauge.overdue else due]
    known = {"start": validity.temperature_start_c, "end": validity.temperature_end_c}
    temperatures = [f"{plain(c, 1)} °C at the {when}" for when, c in known.items() if c is not None]
    rows: dict[str, doc.Blank] = {
        "measured": moment(validity.measured),
        "gauges": tuple(gauges) or None,
        "temperature": ", ".join(temperatures) or None,
        "operator": validity.operator and doc.given(validity.operator),
        "data": (f"{of.readings} {_DATA[of.kind][0]}s, ", doc.code(of.sha256[:12])),
    }
    return {name: row for name, row in rows.items() if name in ("measured", "data", *noted)}


def moment(written: str | None) -> doc.Marked | None:
    """An ISO 8601 time, as people read it."""
    return None if written is None else doc.given(moment_words(datetime.fromisoformat(written)))
