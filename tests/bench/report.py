"""The whole report of a bench, and what it demands."""

from collections.abc import Sequence
from itertools import chain

import numpy as np

from .accuracy import HeldOut, coverage, heldout
from .bench import Group
from .scoring import judge, rates
from .tables import (
    confusion_table,
    coverage_table,
    heldout_table,
    label_table,
    misses,
    rate_table,
)

HELDOUT_RATIO = (0.8, 1.25)
FEWEST = 5
"""Sessions from which a held-out ratio is judged: one scatters by about 11 %, five by 5 %."""
LATER_RATIO = (0.0, 1.3)
MARGINS = ("distinct", "close")


def pooled_later(groups: Sequence[Group]) -> list[HeldOut]:
    """Predictions of second sessions, pooled over the groups by cause."""
    rows = [row for group in groups for row in group.later]
    out = []
    for label in dict.fromkeys(row.label for row in rows):
        mine = [row for row in rows if row.label == label]
        weights = [row.sessions for row in mine]
        before, after = (
            float(np.sqrt(np.average([getattr(row, name) ** 2 for row in mine], weights=weights)))
            for name in ("before", "after")
        )
        out.append(HeldOut(label, sum(weights), before, after))
    return out


def failures(groups: Sequence[Group]) -> list[str]:
    """What the bench demands and did not find, in words."""
    judged = list(chain.from_iterable(group.judged for group in groups))
    found = [
        f"{rate.kind}: {rate.share:.2%} of {rate.total}, demanded {rate.required:.0%}"
        for rate in rates(judged)
        if not rate.met
    ]
    found += [
        f"coverage of {row.label}: {row.share:.1%} of {row.sessions} sessions, "
        f"not within {row.low:.1%} to {row.high:.1%}"
        for row in coverage(judged)
        if not row.honest
    ]
    found += [
        f"held-out ratio of {row.label}: {ratio:.2f}, not within {HELDOUT_RATIO}"
        for row in heldout(judged)
        if row.sessions >= FEWEST
        for ratio in (row.after, row.stated)
        if ratio is not None and not HELDOUT_RATIO[0] <= ratio <= HELDOUT_RATIO[1]
    ]
    found += [
        f"second session of {row.label}: {row.after:.2f} of the noise floor, allowed 1.3"
        for row in pooled_later(groups)
        if not row.after <= LATER_RATIO[1]
    ]
    return found


def full_report(groups: Sequence[Group]) -> str:
    """Everything as text."""
    judged = list(chain.from_iterable(group.judged for group in groups))
    speeds = "\n".join(
        f"{g.machine} {g.gauge}: {len(g.judged)} sessions, {g.per_second:.0f} per second of "
        "processor time, start-up included"
        for g in groups
    )
    wrong = misses([(f"{g.machine}-{g.gauge}", g.judged) for g in groups])
    cases, answers = [j.case for j in judged], [j.answer for j in judged]
    by_margin = [rate for rate in rates(judge(cases, answers, "margin")) if rate.kind in MARGINS]
    parts = [
        ("Rates", rate_table(rates(judged))),
        ("Rates where distance counts beyond the truth's own cost", rate_table(by_margin)),
        ("Right / all, by what was hidden", label_table(judged)),
        ("Confusion: first cause named, or the verdict", confusion_table(judged)),
        (
            "Coverage of the offsets' 95 % intervals, rightly named",
            coverage_table(coverage(judged)),
        ),
        (
            "Held-out errors over what the true model expects (0.8 to 1.25 after)",
            heldout_table(heldout(judged), *HELDOUT_RATIO),
        ),
        (
            "Second session, r.m.s. over one reading's sigma (1.3 at most after)",
            heldout_table(pooled_later(groups), *LATER_RATIO),
        ),
        ("Speed", speeds),
        ("Wrong answers", wrong or "none"),
        ("Demands missed", "\n".join(failures(groups)) or "none"),
    ]
    return "\n\n".join(f"{title}\n{'-' * len(title)}\n{text}" for title, text in parts)
