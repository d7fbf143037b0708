"""Which answers are right, at what rate, and the binomial chances of such rates."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import Any, NamedTuple

from scipy.stats import binom

from .cases import KINDS, Case

# kind: (demanded rate or None, rate of a sound method)
REQUIRED: dict[str, tuple[float | None, float]] = {
    "distinct": (0.97, 0.99),
    "close": (0.97, 0.995),
    "faint": (None, 1.0),
    "healthy": (0.99, 0.998),
    "outside": (0.90, 0.97),
    "pair": (0.90, 0.97),
    "half pair": (None, 1.0),
}


def chance_below(share: float, tries: int, rate: float) -> float:
    """Chance that a method with this true rate shows less than `share` in `tries`."""
    return float(binom.cdf(ceil(share * tries - 1e-9) - 1, tries, rate))


def band(tries: int, low: float, high: float, chance: float = 1e-3) -> tuple[float, float]:
    """Shares that a true rate between `low` and `high` shows, but for `chance` at either end."""
    least, fewest_misses = binom.ppf(chance, tries, (low, 1.0 - high))
    return float(least / tries), float(1.0 - fewest_misses / tries)


@dataclass(frozen=True)
class Answer:
    """One line of `diagnose --json`."""

    said: dict[str, Any]

    @property
    def verdict(self) -> str:
        """As the contract has it, or `error`."""
        return "error" if "error" in self.said else self.said["verdict"]

    @property
    def causes(self) -> list[dict[str, Any]]:
        """Those that the answer accepts, best first."""
        return self.said.get("causes", [])

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(cause["id"] for cause in self.causes)

    @property
    def named(self) -> bool:
        return self.verdict in ("named", "ambiguous")

    @property
    def beyond(self) -> set[str]:
        """Causes that would explain everything far beyond their size."""
        return {each["id"] for each in self.said.get("beyond_tolerance", [])}

    @property
    def mentioned(self) -> set[str]:
        """Every cause in the answer: accepted, an alias of one, ambiguous with it, or beyond."""
        if not self.named:
            return self.beyond
        aliases = (alias for cause in self.causes for alias in cause["aliases"])
        return {*self.ids, *aliases, *self.said["ambiguous_with"]}


@dataclass(frozen=True, eq=False)
class Judged:
    """A case, its answer, and whether that is right."""

    case: Case
    answer: Answer

    @cached_property
    def kind(self) -> str:
        return self.case.kind

    @cached_property
    def right(self) -> bool:
        answer, far, causes = self.answer, self.case.separation, self.case.session.causes
        match self.kind:
            case "healthy":
                return answer.verdict == "consistent"
            case "outside":
                # Several wrong readings are one cause of the list.
                listed = self.case.session.label.endswith("scattered_misreads")
                return answer.verdict == "unexplained" or (listed and answer.ids == ("misread",))
            case "pair":
                return set(causes) <= answer.mentioned
            case "half pair":
                return showing(causes, far.distances, far.bound) <= answer.mentioned
            case "distinct":
                first = answer.ids[:1] if answer.named else ()
                return causes == first or causes[0] in answer.beyond
            case "faint" if answer.verdict == "consistent":
                return True
        return causes[0] in answer.mentioned

    @property
    def rightly_named(self) -> bool:
        """Whether the answer's model is the true one: its single cause, or a healthy machine."""
        if self.kind == "healthy":
            return self.right
        return len(self.case.session.causes) == 1 and self.answer.ids == self.case.session.causes


def showing(causes: Sequence[str], alone: dict[str, float], bound: float) -> set[str]:
    """The hidden causes without which the other alone would be far from the record."""
    if len(causes) < 2:
        return set(causes)
    return {
        cause for cause, other in zip(causes, causes[::-1], strict=True) if alone[other] >= bound
    }


class Rate(NamedTuple):
    """How often one kind of question was answered rightly, and what is demanded."""

    kind: str
    right: int
    total: int

    @property
    def required(self) -> float | None:
        return REQUIRED[self.kind][0]

    @property
    def share(self) -> float:
        return self.right / self.total

    @property
    def met(self) -> bool:
        return self.required is None or self.share >= self.required - 1e-9

    @property
    def false_failure(self) -> float:
        """Chance that a sound method misses the demanded rate with so few sessions."""
        required, sound = REQUIRED[self.kind]
        return 0.0 if required is None else chance_below(required, self.total, sound)

    @property
    def chance_if_met(self) -> float:
        """Chance of so few right answers if the true rate were exactly the demanded one."""
        if self.required is None:
            return 1.0
        return float(binom.cdf(self.right, self.total, self.required))


def rates(judged: Sequence[Judged]) -> list[Rate]:
    total, right = Counter(j.kind for j in judged), Counter(j.kind for j in judged if j.right)
    return [Rate(kind, right[kind], total[kind]) for kind in KINDS if total[kind]]
