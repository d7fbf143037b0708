"""The result of a bench as text, and what it demands."""

from collections import Counter
from collections.abc import Iterable, Sequence

from tests.truth.delta import DeltaSession

from .accuracy import HeldOut, coverage, heldout
from .cases import KINDS
from .real import columns
from .run import Bench
from .scoring import Judged, rates

HELDOUT_RATIO = (0.8, 1.25)
FEWEST = 5
"""Sessions from which a held-out ratio is judged: one scatters by about 11 %, five by 5 %."""
LATER_RATIO = 1.3


def failures(bench: Bench) -> list[str]:
    """What the bench demands and did not find, in words."""
    found = [
        f"{rate.kind}: {rate.share:.2%} of {rate.total}, demanded {rate.required:.0%}"
        for rate in rates(bench.judged)
        if not rate.met
    ]
    if _of_printers(bench):
        return found
    for row in coverage(bench.judged):
        low, high = row.bounds
        if not low <= row.share <= high:
            among = f"{row.share:.1%} of {row.sessions} sessions"
            found.append(f"coverage of {row.label}: {among}, not within {low:.1%} to {high:.1%}")
    found += [
        f"held-out ratio of {row.label}: {ratio:.2f}, not within {HELDOUT_RATIO}"
        for row in heldout(bench.judged)
        if row.sessions >= FEWEST
        for ratio in (row.after, row.stated)
        if ratio is not None and not HELDOUT_RATIO[0] <= ratio <= HELDOUT_RATIO[1]
    ]
    return found + [
        f"second session of {row.label}: {row.after:.2f} of the noise floor, allowed {LATER_RATIO}"
        for row in bench.later
        if not row.after <= LATER_RATIO
    ]


def full_report(bench: Bench) -> str:
    judged = bench.judged
    parts = [
        ("Rates", _rate_table(judged)),
        ("Right / all, by what was hidden", _label_table(judged)),
    ]
    if not _of_printers(bench):
        parts += [
            ("Coverage of 95 % intervals, with bounds of 93 to 97 %", _coverage_table(judged)),
            ("Held-out errors over what the true model expects", _heldout_table(heldout(judged))),
            ("Second session, r.m.s. over one reading's sigma", _heldout_table(bench.later)),
        ]
    wrong = [_miss(item) for item in judged if not item.right]
    parts += [
        ("Wrong answers", "\n".join(wrong) or "none"),
        ("Demands missed", "\n".join(failures(bench)) or "none"),
    ]
    return "\n\n".join(f"{title}\n{'-' * len(title)}\n{text}" for title, text in parts)


def _of_printers(bench: Bench) -> bool:
    return any(isinstance(item.case.session, DeltaSession) for item in bench.judged)


def _rate_table(judged: Sequence[Judged]) -> str:
    """Rates with what is demanded and the chance that a sound method falls short of it."""
    rows = [
        (rate.kind, rate.right, rate.total, f"{rate.share:.2%}",
         "-" if rate.required is None else f"{rate.required:.0%}", f"{rate.false_failure:.1e}")
        for rate in rates(judged)
    ]  # fmt: skip
    return columns("kind,right,of,rate,demanded,false failure", rows)


def _label_table(judged: Sequence[Judged]) -> str:
    """Right over all, by what was hidden and by kind; pairs by each of their two members."""
    total, right = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for item in judged:
        session = item.case.session
        pair = [f"pair with {cause}" for cause in session.causes if len(session.causes) == 2]
        for label in pair or [session.label]:
            total[label, item.kind] += 1
            right[label, item.kind] += item.right
    cells = {key: f"{right[key]}/{count}" for key, count in total.items()}
    labels = dict.fromkeys(label for label, _ in total)
    rows = [(label, *(cells.get((label, kind), "") for kind in KINDS)) for label in labels]
    return columns(",".join(("hidden", *KINDS)), rows)


def _coverage_table(judged: Sequence[Judged]) -> str:
    rows = [
        (row.label, row.sessions, f"{row.share:.1%}", *(f"{bound:.1%}" for bound in row.bounds))
        for row in coverage(judged)
    ]
    return columns("hidden,sessions,coverage,least,most", rows)


def _heldout_table(found: Iterable[HeldOut]) -> str:
    """Ratios without and with the cause, and over what is stated."""
    rows = [
        (label, sessions, *("-" if ratio is None else f"{ratio:.2f}" for ratio in ratios))
        for label, sessions, *ratios in found
    ]
    return columns("hidden,sessions,before,after,stated", rows)


def _miss(item: Judged) -> str:
    """A wrongly answered session, with what made it hard."""
    session, far, answer = item.case.session, item.case.separation, item.answer
    printer = isinstance(session, DeltaSession)
    place = str(session.layout) if printer else " ".join(e.where for e in session.effects)
    stands = ""
    if far:
        stands = f" {far.distance:.1f} from {far.nearest}, {far.visible:.1f} from healthy"
    also = ",".join(sorted(answer.mentioned - set(answer.ids)))
    said = f"{answer.verdict} {','.join(answer.ids)}" + (f" (or {also})" if also else "")
    return f"{item.case.name} [{item.kind}] {place}{stands}: {said} {answer.said.get('error', '')}"
