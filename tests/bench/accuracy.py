"""Whether the numbers behind a right name are honest: intervals, held-out errors, another day."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.truth import CAUSES, PERSISTENT, expected_heldout, second_session, write_readings

from .chance import band
from .run import diagnose
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
        errors = np.array([np.array(j.answer.offsets) - j.case.session.offsets for j in mine])
        inside = np.abs(errors) <= NORMAL_95 * np.array([j.answer.std for j in mine])
        out.append(Coverage(label, int(inside.sum()), len(mine), *band(len(mine), 0.93, 0.97)))
    return out


def heldout(judged: Sequence[Judged]) -> list[HeldOut]:
    """Held-out ratios per cause of the machine, among the rightly named sessions."""
    out = []
    for cause in PERSISTENT:
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
            before, after = np.sqrt(np.mean(np.square(ratios), axis=0))
            own = float(np.sqrt(np.mean(np.square(stated)))) if stated else None
            out.append(HeldOut(cause, len(ratios), float(before), float(after), own))
    return out


def another_day(where: Path, judged: Sequence[Judged], per_cause: int, seed: int) -> list[HeldOut]:
    """Errors of predicting a second session of the same machine, over the gauge's sigma.

    Args:
        where: folder that still holds the machine file and the records.
        judged: answers of that folder.
        per_cause: sessions per cause, the first rightly named and distinct ones.
        seed: draws the second sessions.
    """
    out = []
    for cause in PERSISTENT:
        mine = [
            j
            for j in judged
            if j.case.session.label == cause and j.kind == "distinct" and rightly_named(j)
        ]
        ratios = []
        for item in mine[:per_cause]:
            later = second_session(item.case.session, seed)
            name = write_readings(later, where / f"later-{item.case.name}.csv").name
            extra = ("--holdout", name, "--applied", "0", "0", "0")
            answer = diagnose(where, [f"{item.case.name}.csv"], extra).answers[0]
            if answer.ids == (cause,):
                named, sigma = answer.causes[0], item.case.session.gauge.sigma
                pair = (named.heldout_before, named.heldout_after)
                ratios.append([np.nan if value is None else value / sigma for value in pair])
        if ratios:
            before, after = np.sqrt(np.mean(np.square(ratios), axis=0))
            out.append(HeldOut(cause, len(ratios), float(before), float(after)))
    return out
