"""Effects beyond the list: whether the answer describes them, and what its numbers are worth."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.printers import true_values
from tests.truth import Gauge, Machine, Session, bed
from tests.truth.beyond import HOWS, KINDS, Beyond, Distinction, distinguish, draw_beyond

from .cases import Case
from .report import columns
from .run import run_bench
from .scoring import Answer, band

HOW_RIGHT, WHERE_RIGHT, HELD_OUT, WIDER = 0.95, 0.93, 0.5, 2.0
"""Demanded: two rates, and the largest medians of the held-out ratio and of U over its twin's."""
SPREAD = ("repeats", "scatters")
"""Their noise is part of U, and no reading left out of scatter can be predicted."""


Hidden = Beyond | bed.HiddenInBed


@dataclass(frozen=True, eq=False)
class Described:
    """A hidden effect, and the answers with and without it."""

    hidden: Hidden
    far: Distinction
    answer: Answer
    twin: Answer

    @property
    def pattern(self) -> dict[str, Any]:
        """The first that is told; without `how` if there is none."""
        return next(iter(self.answer.said.get("patterns", [])), {"how": None, "where": {}})

    @property
    def how_right(self) -> bool:
        return self.pattern["how"] in {how for how, _ in self.far.same}

    @property
    def where_right(self) -> bool:
        """The kind of effect too."""
        place = {name: value for name, value in self.pattern["where"].items() if value is not None}
        return (self.pattern["how"], place) in [(how, where.names) for how, where in self.far.same]

    @property
    def misnamed(self) -> bool:
        """Whether a cause is named that does not act; one that acts besides may be."""
        acting = {*self.hidden.session.causes}
        return self.answer.verdict == "named" and not {*self.answer.ids} <= acting

    @property
    def held_out(self) -> float | None:
        """Error of left-out cycles with the pattern over that without it."""
        before, after = (self.pattern.get(f"heldout_{when}_mm") for when in ("before", "after"))
        return after / before if before and after is not None else None

    @property
    def inside(self) -> list[bool]:
        """Whether U holds each true parameter."""
        session = self.hidden.session
        true = (
            session.offsets
            if isinstance(session, Session)
            else true_values(session.machine, session.truth)
        )
        pairs = zip(self._parameters(self.answer), true, strict=False)
        return [abs(one["found"] - true) <= one["expanded"] for one, true in pairs]

    @property
    def wider(self) -> list[float]:
        """U of each offset over that of the same session without the effect."""
        pairs = zip(self._parameters(self.answer), self._parameters(self.twin), strict=False)
        return [one["expanded"] / other["expanded"] for one, other in pairs]

    @staticmethod
    def _parameters(answer: Answer) -> list[dict[str, Any]]:
        return [one for one in answer.said.get("parameters", []) if one["expanded"] is not None]

    @property
    def released(self) -> bool:
        return bool(self.answer.said.get("release", {}).get("usable"))


def draw_hidden(
    machines: Sequence[Machine], gauges: Sequence[Gauge], count: int, seed: int
) -> Iterator[tuple[str, Hidden]]:
    """Sessions with names: each effect in turn, somewhere; half of them beside a listed cause."""
    for n in range(count):
        rng = np.random.default_rng([seed, n, 7])
        how = HOWS[n % len(HOWS)]
        machine, gauge = machines[rng.integers(len(machines))], gauges[rng.integers(len(gauges))]
        kind, beside = str(rng.choice(KINDS[how])), bool(n // len(HOWS) % 2)
        drawn = draw_beyond(100_000 * seed + n, machine, gauge, how, kind, beside)
        yield f"beyond-{n:03d}", drawn


def draw_beds(count: int, seed: int) -> Iterator[tuple[str, Hidden]]:
    """Probed beds with names: each effect in turn, in each kind of region in turn."""
    kinds = list(bed.KINDS)
    for n in range(count):
        how, kind = bed.HOWS[n % len(bed.HOWS)], kinds[n // len(bed.HOWS) % len(kinds)]
        yield f"bed-{n:03d}", bed.draw_bed(100_000 * seed + n, how, kind)


def run_beyond(drawn: Iterator[tuple[str, Hidden]], keep: Path | None = None) -> list[Described]:
    hidden = dict(drawn)
    cases = [
        Case(name + end, session, None)
        for name, one in hidden.items()
        for end, session in (("", one.session), ("-twin", one.twin))
    ]
    answers = {item.case.name: item.answer for item in run_bench(cases, keep=keep).judged}
    return [
        Described(
            one,
            distinguish(one) if isinstance(one, Beyond) else bed.distinguish_bed(one),
            answers[name],
            answers[f"{name}-twin"],
        )
        for name, one in hidden.items()
    ]


def _share(values: Sequence[bool]) -> str:
    return f"{np.mean(values):.1%}" if values else "-"


def _median(values: Sequence[float | None]) -> float | None:
    given = [value for value in values if value is not None]
    return float(np.median(given)) if given else None


def _row(label: str, every: Sequence[Described]) -> tuple[object, ...]:
    asked = [item for item in every if item.far.clear]
    wider = [ratio for item in asked for ratio in item.wider]
    medians = _median([item.held_out for item in asked]), _median(wider)
    return (
        label, len(every), len(asked), _share([item.how_right for item in asked]),
        _share([item.where_right for item in asked]),
        _share([item.answer.verdict == "unexplained" for item in asked]),
        "-" if medians[0] is None else f"{medians[0]:.2f}",
        _share([one for item in asked for one in item.inside]),
        "-" if medians[1] is None else f"{medians[1]:.2f}",
        _share([ratio <= WIDER for ratio in wider]), _share([item.released for item in asked]),
    )  # fmt: skip


def _table(title: str, described: Sequence[Described], key: Callable[[Described], str]) -> str:
    groups: dict[str, list[Described]] = {}
    for item in described:
        groups.setdefault(key(item), []).append(item)
    header = f"{title},drawn,clear,how,where,unexplained,held-out,coverage,U ratio,up to 2,released"
    return columns(header, [_row(label or "nothing", mine) for label, mine in groups.items()])


def _miss(name: int, item: Described) -> str:
    hidden, near, told = item.hidden, item.far.nearest, item.pattern
    causes = "+".join((*hidden.session.causes, ""))
    rival = f"{near.sigma:.1f} from {near.how or 'the list'} {near.where.names or ''}".strip()
    probability = told.get("probability")
    said = f"{told['how']} {told['where']}" + ("" if probability is None else f" {probability:.2f}")
    size = np.abs(hidden.session.readings - hidden.twin.readings).max()
    return (
        f"{name:03d} {causes}{hidden.how} {hidden.where.names} shape {hidden.shape:.2f},"
        f" {size:.3f} mm, {hidden.session.machine.name}; {rival}:"
        f" {item.answer.verdict} {','.join(item.answer.ids)} {said}"
    )


def failures_beyond(described: Sequence[Described]) -> list[str]:
    """What is demanded of the clear sessions and missed."""
    asked = [item for item in described if item.far.clear]
    out = []
    for label, right, demanded in (
        ("how", [item.how_right for item in asked], HOW_RIGHT),
        ("how and where", [item.where_right for item in asked], WHERE_RIGHT),
    ):
        if np.mean(right) < demanded:
            out.append(f"{label}: {_share(right)} of {len(right)}, demanded {demanded:.0%}")
    if wrong := sum(item.misnamed for item in asked):
        out.append(f"named although it does not act: {wrong} of {len(asked)}, demanded 0")
    inside = [one for item in asked for one in item.inside]
    low, high = band(len(asked), 0.93, 0.97)
    if not low <= np.mean(inside) <= high:
        out.append(f"coverage: {_share(inside)}, not within {low:.1%} to {high:.1%}")
    for how in HOWS:
        mine = [item for item in asked if item.hidden.how == how]
        left = _median([item.held_out for item in mine])
        wider = _median([ratio for item in mine for ratio in item.wider])
        if how != "scatters" and left is not None and left > HELD_OUT:
            out.append(f"held-out ratio of {how}: {left:.2f}, at most {HELD_OUT}")
        if how not in SPREAD and wider is not None and wider > WIDER:
            out.append(f"U with {how}: {wider:.2f} times that without, at most {WIDER}")
    return out


def report_beyond(described: Sequence[Described]) -> str:
    """Tables by effect, place and company; confusions; what went wrong."""
    told = Counter(
        (item.hidden.how, str(item.pattern["how"])) for item in described if item.far.clear
    )
    rows = [(how, *(told[how, other] or "" for other in (*HOWS, "None"))) for how in HOWS]
    missed = [
        _miss(n, item)
        for n, item in enumerate(described)
        if item.far.clear and not item.where_right
    ]
    parts = (
        ("All", _table("hidden", described, lambda item: "all")),
        ("By effect", _table("how", described, lambda item: item.hidden.how)),
        ("By place", _table("where", described, lambda item: item.hidden.where.kind)),
        ("Beside", _table("beside", described, lambda item: "".join(item.hidden.session.causes))),
        ("First pattern told", columns(",".join(("hidden", *HOWS, "none")), rows)),
        ("Wrong descriptions", "\n".join(missed) or "none"),
        ("Demands missed", "\n".join(failures_beyond(described)) or "none"),
    )  # fmt: skip
    return "\n\n".join(f"{title}\n{'-' * len(title)}\n{text}" for title, text in parts)
