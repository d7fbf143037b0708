"""One input with its answer, as documents take it: words of its machine, and what to type next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.diagnosis import Verdict
from orthoglide_cal.errors import command
from orthoglide_cal.files import Conditions, Input
from orthoglide_cal.model import AXES, Cause, Machine, Source
from orthoglide_cal.model.vocabulary import Vocabulary
from orthoglide_cal.results import Answer, CheckReading, Recording, Remedy, recording
from orthoglide_cal.words import plain, short, with_uncertainty

# Instead of "may be entered", where there is nothing to change.
SETTLED = "Nothing to enter: the firmware has these values, as well as these readings know them"
_TAKING_METHODS = ("solve", "report", "export")


def about(
    verb: str, source: Source, *others: str, machine: Path | None = None, options: str = ""
) -> str:
    """A command about what was read of a file, with what was chosen of it, and other files."""
    chosen = f"--data {source.excerpt.data}" if source.excerpt else ""
    given = f"{chosen} {options}".strip()
    return command(verb, source.path, *others, machine=machine, options=given)


@dataclass(frozen=True, eq=False)
class Case:
    """What a page is about.

    Attributes:
        given: the input.
        answer: to it.
        machine_file: as the user gave it, for the commands to run next.
    """

    given: Input
    answer: Answer
    machine_file: Path | None = None

    @property
    def source(self) -> Source:
        """Where the data came from."""
        return self.given.measured.source

    @property
    def machine(self) -> Machine:
        """The machine that they are judged by."""
        return self.given.model.machine

    @property
    def words(self) -> Vocabulary:
        """What its kind calls things."""
        return self.machine.vocabulary

    @property
    def unit(self) -> str:
        """Of all parameters; "" where they have several."""
        units = {each.unit for each in self.answer.parameters}
        return units.pop() if len(units) == 1 else ""

    @property
    def known(self) -> tuple[Cause, ...]:
        """Lasting causes of the machine: accepted ones, and those that were found."""
        found = [CAUSES[cause.id] for cause in self.answer.causes]
        named = found if self.answer.verdict is Verdict.NAMED else []
        lasting = [cause for cause in named if cause.in_machine and cause.lasting]
        return (*(effect.cause for effect in self.given.model.accepted), *lasting)

    def typed(self, verb: str, options: str = "") -> str:
        """A command about the same input, with what was given for it, and further options."""
        method = self.answer.method
        if verb in _TAKING_METHODS and method not in (None, self.answer.input.kind):
            options = f"--method {method} {options}".strip()
        return about(verb, self.source, machine=self.machine_file, options=options)

    def remedied(self, remedy: Remedy) -> str | None:
        """What to type for a remedy; None where there is nothing to type."""
        return None if remedy.verb is None else self.typed(remedy.verb, remedy.options)

    @property
    def verify(self) -> str:
        """What to type once the parameters were entered and the session was measured again.

        With what was entered, where no machine file can tell.
        """
        unknown = not self.machine.keeps_itself and recording(self.given) is Recording.NOWHERE
        digits = self.answer.decimals
        changes = " ".join(plain(each.change(digits), digits) for each in self.answer.parameters)
        options = f"--applied {changes}" if unknown else ""
        return about("verify", self.source, "AFTER", machine=self.machine_file, options=options)

    @property
    def record(self) -> str | None:
        """What to type once they were entered; None where that is recorded, or nowhere kept."""
        return self.typed("apply") if recording(self.given) is Recording.DUE else None

    @property
    def table(self) -> str | None:
        """What to type for a table that takes out what offsets leave; None where none would."""
        known = any(effect.cause.compensable for effect in self.given.model.accepted)
        return self.typed("export", "--format table") if known and self.answer.remains else None

    def remedy_lines(self) -> Iterator[str]:
        """What to do instead of entering, each in one line with what to type."""
        for remedy in self.answer.release.remedies:
            yield f"{remedy.sentence} {self.remedied(remedy) or ''}".rstrip()


def check_words(check: CheckReading) -> str:
    """The check posture as an instruction, without the number that is expected."""
    if check.ends:
        return (
            f"Check: drive to {_position(check.first_mm)}. Read the height of leg {check.leg} along"
            f" {check.direction} at the joint end, then at the tool end. The second reading minus"
            " the first should be"
        )
    return (
        f"Check: put the gauge at the middle of leg {check.leg}, along {check.direction}. Read it"
        f" at {_position(check.first_mm)}, then at {_position(check.second_mm)}. The second reading"
        " minus the first should be"
    )


def _position(tool: Sequence[float]) -> str:
    """ "X60 Y0 Z0": a tool position as it is typed."""
    return " ".join(f"{a.upper()}{short(value, 3)}" for a, value in zip(AXES, tool, strict=True))


def expected_words(check: CheckReading) -> str:
    """The number that the check should give, with its tolerance."""
    return f"{with_uncertainty(check.expected_mm, check.expanded_mm)} mm"


def measure_again(conditions: Conditions | None) -> str:
    """What to type to measure again: a simulated machine comes back with its seed."""
    seed = dict(conditions.environment).get("seed") if conditions else None
    options = f"--gauge simulated --seed {seed}" if seed and seed.isdecimal() else ""
    return command("measure", options=options)
