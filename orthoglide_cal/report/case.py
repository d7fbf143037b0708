"""A result to be shown, in the words of its machine, and the commands that go on from it."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.errors import UnusableResultError, command
from orthoglide_cal.files.input import Input
from orthoglide_cal.inference.result import Parameter, Verdict
from orthoglide_cal.model.machine import Machine, Vocabulary
from orthoglide_cal.model.measured import DataKind, Source
from orthoglide_cal.model.model import Cause, Estimate
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.sentences import sentence
from orthoglide_cal.results.answer import RETAKE, THEN, Answer, CheckReading
from orthoglide_cal.results.application import recording
from orthoglide_cal.schema import Reason
from orthoglide_cal.words import (
    counted,
    decimals_for,
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
# Reasons that make a result worthless if they are overlooked: they stand first.
INVALIDATING = ("overdue_gauge", "stale_mesh", "nozzle_lower")
LARGEST_OFFSET = 10.0  # beyond it a length or an angle is no offset


@dataclass(frozen=True, eq=False)
class Case:
    """An answer with its input."""

    given: Input
    answer: Answer
    options: Mapping[str, object] = field(default_factory=dict)  # further ones of diagnose

    @property
    def source(self) -> Source:
        return self.given.measured.source

    @property
    def machine(self) -> Machine:
        return self.given.model.machine

    @property
    def words(self) -> Vocabulary:
        return self.machine.vocabulary

    def says(self, reason: Reason) -> str:
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
        named = (CAUSES[cause.id] for cause in sure)
        lasting = (cause for cause in named if cause.in_machine and cause.lasting)
        return (*(effect.cause for effect in self.given.model.remaining()), *lasting)

    @property
    def method(self) -> str | None:
        """The method, if another one than the usual was asked for."""
        return self.answer.method if self.answer.method != self.answer.input.kind else None

    def typed(self, verb: str, *options: str, other: str = "") -> str:
        """A command about this input, with what was given for it, more options, another file."""
        excerpt, paths = self.source.excerpt, [self.source.path]
        given = [f"--data {excerpt.data}"] if excerpt and excerpt.data else []
        if verb == "diagnose" and self.source.earlier:
            paths = [*self.source.earlier, *paths]
            given.append("--together")
        if self.method is not None and verb in ("solve", "report", "export"):
            given.append(f"--method {self.method}")
        given += filter(None, options)
        if verb in ("solve", "diagnose", "report", "export", "apply"):
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

    def require_usable(self, force: bool | None = None) -> None:
        """Raise UnusableResultError, with what to do instead, if the result must not be used.

        `force`: use it nevertheless; None where nobody can.
        """
        release, known = self.answer.release, self.answer.parameters
        if known and (release.usable or force):
            return
        remedies = [" ".join(part.text for part in doc.parts_of(step)) for step in self.remedies()]
        if known and force is not None:
            remedies.append("To export it anyway, marked as FORCED: --force")
        why = " ".join(map(self.says, release.reasons))
        raise UnusableResultError(f"Do not use these {self.words.many}. {why}", "\n".join(remedies))

    @property
    def verify(self) -> str:
        """The command to compare with once the parameters were entered and measured again.

        It holds what was entered where no machine file can tell; the option takes three values.
        """
        digits, known = self.answer.decimals, self.answer.parameters
        unknown = recording(self.given) == "nowhere" and len(known) == len(AXES)
        changes = " ".join(plain(size.change(digits), digits) for size in known)
        return self.typed("verify", f"--applied {changes}" * unknown, other="AFTER")

    @property
    def record(self) -> str | None:
        """The command that records what was entered; None where it is recorded, or nowhere kept."""
        return self.typed("apply") if recording(self.given) == "due" else None

    def further(self, session: str | None) -> str | None:
        """The command to go on from these readings, or for a `session` with such options."""
        then = self.source.path if session is None else None
        if then == "-":
            return None
        return self.machine.measuring(self.given.machine_file, session or "", then=then)

    @property
    def for_controllers(self) -> bool:
        """False for what was practised."""
        return not (self.answer.simulated or self.machine.practice)

    @property
    def table(self) -> str | None:
        """The command for a table that corrects what offsets leave; None where none would."""
        known = any(effect.cause.compensable for effect in self.given.model.accepted)
        wanted = known and "remains" in self.answer.release.codes and self.for_controllers
        return self.typed("export", "--format table") if wanted else None


def check_words(check: CheckReading) -> str:
    """The check posture as an instruction, with the number that is expected."""
    code = "check_ends" if check.ends else "check_drive"
    moves = with_uncertainty(check.expected_mm, check.expanded_mm)
    today = signed(check.before_mm, decimals_for(check.expanded_mm))
    first, second = (position_words(place, 3) for place in (check.first_mm, check.second_mm))
    data = {"check": check, "first": first, "second": second, "moves": moves, "today": today}
    return sentence(Reason.of(code, **data))


def size_words(value: float, expanded: float, unit: str) -> str:
    """Value ± U, with the unit; whole numbers have no U, and what is no offset has no "+"."""
    number = with_uncertainty(value, expanded) if expanded else signed(value, 0)
    number = number.removeprefix("+") if abs(value) > LARGEST_OFFSET else number
    return f"{number} {unit_words(unit)}".rstrip()


def sizes_words(sizes: Iterable[Estimate | Parameter]) -> str:
    """Names, values ± U and units of what is determined; a unit behind the last that has it.

    >>> sizes_words([Estimate(name=axis, value=-0.1, std=0.01, unit="mm") for axis in "xy"])
    'x −0.100 ± 0.020, y −0.100 ± 0.020 mm'
    """
    values = ((e, e.found if isinstance(e, Parameter) else e.value) for e in sizes)
    rows, texts = [(size, value) for size, value in values if value is not None], []
    for (size, value), later in zip_longest(rows, rows[1:]):
        last = later is None or later[0].unit != size.unit
        texts.append(f"{size.name} {size_words(value, size.expanded, size.unit if last else '')}")
    return ", ".join(texts)


def position_words(tool_mm: Sequence[float], decimals: int) -> str:
    """ "X60 Y0 Z0": a tool position as it is typed."""
    pairs = zip(AXES, tool_mm, strict=False)
    return " ".join(f"{axis.upper()}{short(value, decimals)}" for axis, value in pairs)


def measure_again(given: Input) -> str | None:
    """The command to measure again, if any: a simulated machine comes back with its seed."""
    seed = dict(given.conditions.environment).get("seed")
    options = f"--gauge simulated --seed {seed}" if seed and seed.isdecimal() else ""
    return given.model.machine.measuring(given.machine_file, options)


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


def comparison_words(single: bool) -> tuple[str, str]:
    """The kind of differences that are promised, and the meaning of their names."""
    if single:
        return "tool end − joint end", "dz_x+ is along z on leg x at max."
    return "max − min", "dx_y is along x on leg y."
