"""Whether the numbers behind a right name are honest: intervals, held-out errors, another day."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from tests.truth import CAUSES, MACHINE_CAUSES, Session, expected_heldout, second_session

from .scoring import Answer, Judged, band

NORMAL_95 = 1.959964
BEFORE, AFTER, STATED = "heldout_before_mm", "heldout_after_mm", "heldout_ratio"


class Coverage(NamedTuple):
    """How often the 95 % intervals of the offsets hold the truth."""

    label: str
    inside: int
    """Of three intervals per session."""
    sessions: int

    @property
    def share(self) -> float:
        return self.inside / (3 * self.sessions)

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the share if the true coverage is 93 to 97 %, but for 1 in 1000 at either end.

        Sessions count, not intervals: the three offsets of a session share their noise.
        """
        return band(self.sessions, 0.93, 0.97)


class HeldOut(NamedTuple):
    """Held-out errors over what is expected of them, r.m.s. of the ratios."""

    label: str
    sessions: int
    before: float
    """Without the cause."""
    after: float
    """With it."""
    stated: float | None = None
    """Over what the answers themselves state, where they do."""


def coverage(judged: Sequence[Judged]) -> list[Coverage]:
    """Coverage per hidden cause, among the rightly named sessions, and for healthy ones."""
    out = []
    for label in ("healthy", *CAUSES):
        mine = [j for j in judged if j.case.session.label == label and j.rightly_named]
        inside = [
            abs(each["found"] - true) <= NORMAL_95 * each["std"]
            for j in mine
            for each, true in zip(j.answer.said["parameters"], j.case.session.offsets, strict=True)
        ]
        if mine:
            out.append(Coverage(label, sum(inside), len(mine)))
    return out


def _pooled(label: str, ratios: Sequence[tuple[float, float]], stated: Sequence[float]) -> HeldOut:
    before, after = np.sqrt(np.mean(np.square(ratios), axis=0))
    own = float(np.sqrt(np.mean(np.square(stated)))) if stated else None
    return HeldOut(label, len(ratios), float(before), float(after), own)


def heldout(judged: Sequence[Judged]) -> list[HeldOut]:
    """Ratios to what the true model expects, per cause of the machine, rightly named."""
    out = []
    for cause in MACHINE_CAUSES:
        mine = [j for j in judged if j.case.session.label == cause and j.rightly_named]
        told = [(j.answer.causes[0], expected_heldout(j.case.session)) for j in mine]
        told = [(named, expected) for named, expected in told if named[AFTER] is not None]
        ratios = [(named[BEFORE] / expected, named[AFTER] / expected) for named, expected in told]
        stated = [named[STATED] for named, _ in told if named[STATED] is not None]
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
            if session.label != cause or item.kind != "distinct" or not item.rightly_named:
                continue
            group = (cause, session.machine.name, session.gauge.name)
            asked[group] += 1
            if asked[group] > count:
                continue
            answer = ask(item, second_session(session, seed))
            if answer.ids == (cause,):
                named, sigma = answer.causes[0], session.gauge.sigma
                ratios.append((named[BEFORE] / sigma, named[AFTER] / sigma))
        if ratios:
            out.append(_pooled(cause, ratios, ()))
    return out
