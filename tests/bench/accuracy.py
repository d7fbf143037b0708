"""Whether the numbers behind a right name are honest: intervals, held-out errors, another day."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tests.truth import CAUSES, MACHINE_CAUSES, Session, expected_heldout, second_session

from .answers import Answer
from .chance import band
from .scoring import Judged

NORMAL_95 = 1.959964


@dataclass(frozen=True)
class Coverage:
    """How often the 95 % intervals of the offsets hold the truth."""

    label: str
    inside: int
    """Of three intervals per session."""
    sessions: int
    low: float
    """Least share to be expected if the true coverage is 93 % at least, but for 1 in 1000."""
    high: float
    """Greatest share to be expected if it is 97 % at most, but for 1 in 1000."""

    @property
    def share(self) -> float:
        """Intervals that hold the truth over all."""
        return self.inside / (3 * self.sessions)

    @property
    def honest(self) -> bool:
        """Whether the share can come from a coverage of 93 to 97 %."""
        return self.low <= self.share <= self.high


@dataclass(frozen=True)
class HeldOut:
    """Held-out errors under the true cause over what an honest model expects of them."""

    label: str
    sessions: int
    before: float
    """r.m.s. of the ratios without the cause."""
    after: float
    """r.m.s. of the ratios with it: 0.8 to 1.25 is demanded."""
    stated: float | None = None
    """r.m.s. of the ratios that the answers state themselves, where they do; the same bounds."""


def rightly_named(item: Judged) -> bool:
    """Whether the answer's model is the true one: its single cause, or a healthy machine."""
    if item.kind == "healthy":
        return item.answer.verdict == "consistent"
    return len(item.case.session.causes) == 1 and item.answer.ids == item.case.session.causes


def coverage(judged: Sequence[Judged]) -> list[Coverage]:
    """Coverage per hidden cause, among the rightly named sessions, and for healthy ones.

    The band counts sessions, not intervals: the three offsets of a session share their noise.
    """
    out = []
    for label in ("healthy", *CAUSES):
        mine = [j for j in judged if j.case.session.label == label and rightly_named(j)]
        if not mine:
            continue
        errors = np.array([np.array(j.answer.found) - j.case.session.offsets for j in mine])
        inside = np.abs(errors) <= NORMAL_95 * np.array([j.answer.std for j in mine])
        out.append(Coverage(label, int(inside.sum()), len(mine), *band(len(mine), 0.93, 0.97)))
    return out


def _pooled(
    label: str, ratios: Sequence[tuple[float, float]], stated: Sequence[float] = ()
) -> HeldOut:
    before, after = np.sqrt(np.mean(np.square(ratios), axis=0))
    own = float(np.sqrt(np.mean(np.square(stated)))) if stated else None
    return HeldOut(label, len(ratios), float(before), float(after), own)


def heldout(judged: Sequence[Judged]) -> list[HeldOut]:
    """Held-out ratios per cause of the machine, among the rightly named sessions."""
    out = []
    for cause in MACHINE_CAUSES:
        ratios, stated = [], []
        for item in judged:
            if item.case.session.label != cause or not rightly_named(item):
                continue
            named = item.answer.causes[0]
            if named.heldout_before is not None and named.heldout_after is not None:
                expected = expected_heldout(item.case.session)
                ratios.append((named.heldout_before / expected, named.heldout_after / expected))
                if named.heldout_ratio is not None:
                    stated.append(named.heldout_ratio)
        if ratios:
            out.append(_pooled(cause, ratios, stated))
    return out


def another_day(
    judged: Sequence[Judged], count: int, seed: int, ask: Callable[[Judged, Session], Answer]
) -> list[HeldOut]:
    """Errors of predicting a second session of the same machine, over the gauge's sigma.

    Args:
        judged: answers.
        count: sessions per cause, machine and gauge: the first rightly named and distinct ones.
        seed: draws the second sessions.
        ask: the answer with the second session held out.
    """
    out, asked = [], Counter[tuple[str, str, str]]()
    for cause in MACHINE_CAUSES:
        ratios = []
        for item in judged:
            session = item.case.session
            if session.label != cause or item.kind != "distinct" or not rightly_named(item):
                continue
            group = (cause, session.machine.name, session.gauge.name)
            asked[group] += 1
            if asked[group] > count:
                continue
            answer = ask(item, second_session(session, seed))
            if answer.ids == (cause,):
                named = answer.causes[0]
                pair = (named.heldout_before, named.heldout_after)
                before, after = (np.nan if v is None else v / session.gauge.sigma for v in pair)
                ratios.append((before, after))
        if ratios:
            out.append(_pooled(cause, ratios))
    return out
