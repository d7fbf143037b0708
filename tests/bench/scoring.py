"""Which answers are right, and at what rate."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from .answers import Answer
from .cases import KINDS, Case
from .chance import chance_at_most, chance_below


@dataclass(frozen=True)
class Judged:
    """A case, its answer, and whether that is right."""

    case: Case
    answer: Answer
    kind: str
    right: bool


@dataclass(frozen=True)
class Rate:
    """How often one kind of question was answered rightly, and what is demanded."""

    kind: str
    right: int
    total: int
    required: float | None
    sound: float
    """Rate that a sound method has; used to state the chance of a false failure."""

    @property
    def share(self) -> float:
        """Right answers over all (1 without any)."""
        return self.right / self.total if self.total else 1.0

    @property
    def met(self) -> bool:
        """Whether the demanded rate is reached."""
        return self.required is None or self.share >= self.required - 1e-9

    @property
    def false_failure(self) -> float:
        """Chance that a sound method misses the demanded rate with so few sessions."""
        return 0.0 if self.required is None else chance_below(self.required, self.total, self.sound)

    @property
    def chance_if_met(self) -> float:
        """Chance of so few right answers if the true rate were exactly the demanded one."""
        if self.required is None or not self.total:
            return 1.0
        return chance_at_most(self.right, self.total, self.required)


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


def showing(causes: Sequence[str], alone: dict[str, float], bound: float) -> set[str]:
    """The hidden causes without which the other alone would be far from the record."""
    if len(causes) < 2:
        return set(causes)
    return {
        cause for cause, other in zip(causes, causes[::-1], strict=True) if alone[other] >= bound
    }


def is_right(case: Case, answer: Answer, kind: str) -> bool:
    """Whether an answer is what the data allow one to say; `kind` as given by `Case.kind`."""
    if kind == "healthy":
        return answer.verdict == "consistent"
    if kind == "outside":
        return answer.verdict == "unexplained"
    if kind == "pair":
        return set(case.session.causes) <= answer.mentioned
    if kind == "half pair":
        far = case.separation
        return showing(case.session.causes, far.distances, far.bound) <= answer.mentioned
    truth = case.session.causes[0]
    if kind == "distinct":
        return answer.first == truth or truth in answer.beyond
    return truth in answer.mentioned or (kind == "faint" and answer.verdict == "consistent")


def judge(cases: Sequence[Case], answers: Sequence[Answer]) -> list[Judged]:
    """Judge each answer against its case."""
    pairs = zip(cases, answers, strict=True)
    return [Judged(case, answer, case.kind(), is_right(case, answer, case.kind()))
            for case, answer in pairs]  # fmt: skip


def rates(judged: Sequence[Judged]) -> list[Rate]:
    """One rate per kind that occurred."""
    total, right = Counter(j.kind for j in judged), Counter(j.kind for j in judged if j.right)
    return [Rate(kind, right[kind], total[kind], *REQUIRED[kind]) for kind in KINDS if total[kind]]


def rates_by_label(judged: Sequence[Judged]) -> dict[str, dict[str, tuple[int, int]]]:
    """(right, total) for each kind, by what was hidden; pairs by each of their two members."""
    out: dict[str, dict[str, tuple[int, int]]] = {}
    for item in judged:
        causes = item.case.session.causes
        names = (
            [f"pair with {c}" for c in causes] if len(causes) == 2 else [item.case.session.label]
        )
        for name in names:
            right, total = out.setdefault(name, {}).get(item.kind, (0, 0))
            out[name][item.kind] = (right + item.right, total + 1)
    return out


def confusion(judged: Sequence[Judged]) -> dict[str, Counter[str]]:
    """What was answered first, by what was hidden; without the pairs."""
    out: dict[str, Counter[str]] = {}
    for item in judged:
        if len(item.case.session.causes) < 2:
            out.setdefault(item.case.session.label, Counter())[item.answer.first] += 1
    return out


def both_accepted(judged: Sequence[Judged]) -> tuple[int, int]:
    """(right, total) of the distinct pairs when aliases do not count."""
    pairs = [j for j in judged if j.kind == "pair"]
    return sum(set(j.case.session.causes) <= set(j.answer.ids) for j in pairs), len(pairs)
