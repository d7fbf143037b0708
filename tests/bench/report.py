"""The result of a bench as text, and what it demands."""

from collections.abc import Iterable, Sequence

from tests.truth.delta import DeltaSession

from .accuracy import Coverage, HeldOut, coverage, heldout
from .cases import KINDS
from .run import Bench
from .scoring import Judged, Rate, both_accepted, confusion, rates, rates_by_label

HELDOUT_RATIO = (0.8, 1.25)
FEWEST = 5
"""Sessions from which a held-out ratio is judged: one scatters by about 11 %, five by 5 %."""
LATER_RATIO = (0.0, 1.3)
MISSES = 40
"""So many wrong answers are listed."""


def failures(bench: Bench) -> list[str]:
    """What the bench demands and did not find, in words."""
    found = [
        f"{rate.kind}: {rate.share:.2%} of {rate.total}, demanded {rate.required:.0%}"
        for rate in rates(bench.judged)
        if not rate.met
    ]
    if _of_printers(bench):
        return found
    found += [
        f"coverage of {row.label}: {row.share:.1%} of {row.sessions} sessions, "
        f"not within {row.low:.1%} to {row.high:.1%}"
        for row in coverage(bench.judged)
        if not row.honest
    ]
    found += [
        f"held-out ratio of {row.label}: {ratio:.2f}, not within {HELDOUT_RATIO}"
        for row in heldout(bench.judged)
        if row.sessions >= FEWEST
        for ratio in (row.after, row.stated)
        if ratio is not None and not HELDOUT_RATIO[0] <= ratio <= HELDOUT_RATIO[1]
    ]
    return found + [
        f"second session of {row.label}: {row.after:.2f} of the noise floor, allowed 1.3"
        for row in bench.later
        if not row.after <= LATER_RATIO[1]
    ]


def full_report(bench: Bench) -> str:
    """Everything as text."""
    judged = bench.judged
    parts = [
        ("Rates", _rate_table(rates(judged))),
        ("Right / all, by what was hidden", _label_table(judged)),
        ("First cause named, or the verdict", _confusion_table(judged)),
    ]
    if not _of_printers(bench):
        inside = _coverage_table(coverage(judged))
        expected = _heldout_table(heldout(judged), *HELDOUT_RATIO)
        later = _heldout_table(bench.later, *LATER_RATIO)
        parts += [
            ("Coverage of the offsets' 95 % intervals, rightly named", inside),
            ("Held-out errors over what the true model expects (0.8 to 1.25 after)", expected),
            ("Second session, r.m.s. over one reading's sigma (1.3 at most after)", later),
        ]
    wrong = [_miss(item) for item in judged if not item.right]
    more = [f"… and {len(wrong) - MISSES} more"] if len(wrong) > MISSES else []
    speed = f"{len(judged)} sessions, {bench.per_second:.0f} per second of processor time"
    parts += [
        ("Speed, start-up included", speed),
        ("Wrong answers", "\n".join((*wrong[:MISSES], *more)) or "none"),
        ("Demands missed", "\n".join(failures(bench)) or "none"),
    ]
    return "\n\n".join(f"{title}\n{'-' * len(title)}\n{text}" for title, text in parts)


def _of_printers(bench: Bench) -> bool:
    return any(isinstance(item.case.session, DeltaSession) for item in bench.judged)


def _rate_table(found: Sequence[Rate]) -> str:
    """Rates with what is demanded and the chance that a sound method falls short of it."""
    lines = [f"{'kind':<12}{'right':>7}{'of':>7}{'rate':>9}{'demanded':>10}{'false failure':>15}"]
    for rate in found:
        demanded = "-" if rate.required is None else f"{rate.required:.0%}"
        cells = f"{rate.kind:<12}{rate.right:>7}{rate.total:>7}{rate.share:>9.2%}{demanded:>10}"
        lines.append(f"{cells}{rate.false_failure:>15.1e}{'' if rate.met else '  MISSED'}")
    return "\n".join(lines)


def _label_table(judged: Sequence[Judged]) -> str:
    """Right over all, by what was hidden and by kind."""
    lines = [f"{'hidden':<30}" + "".join(f"{kind:>11}" for kind in KINDS)]
    for label, kinds in rates_by_label(judged).items():
        cells = ("/".join(map(str, kinds[kind])) if kind in kinds else "" for kind in KINDS)
        lines.append(f"{label:<30}" + "".join(f"{cell:>11}" for cell in cells))
    accepted, total = both_accepted(judged)
    if total:
        lines.append(f"pairs with both members accepted, aliases not counted: {accepted}/{total}")
    return "\n".join(lines)


def _confusion_table(judged: Sequence[Judged]) -> str:
    """What was answered first, by what was hidden, the most frequent first."""
    return "\n".join(
        f"{label:<28}" + ", ".join(f"{name} {count}" for name, count in counts.most_common())
        for label, counts in confusion(judged).items()
    )


def _coverage_table(found: Sequence[Coverage]) -> str:
    """Coverage of the offsets' 95 % intervals with the band of honest intervals."""
    lines = [f"{'hidden':<18}{'sessions':>9}{'coverage':>10}{'band of 93-97 %':>18}"]
    for row in found:
        cells = f"{row.label:<18}{row.sessions:>9}{row.share:>10.1%}{row.low:>10.1%}"
        lines.append(f"{cells} -{row.high:>6.1%}{'' if row.honest else '  MISSED'}")
    return "\n".join(lines)


def _heldout_table(found: Iterable[HeldOut], low: float, high: float) -> str:
    """r.m.s. ratios before and after the extension and as stated; after: `low` to `high`."""
    lines = [f"{'hidden':<18}{'sessions':>9}{'before':>9}{'after':>9}{'stated':>9}"]
    for row in found:
        good = all(low <= value <= high for value in (row.after, row.stated) if value is not None)
        stated = "-" if row.stated is None else f"{row.stated:.2f}"
        cells = f"{row.label:<18}{row.sessions:>9}{row.before:>9.2f}{row.after:>9.2f}{stated:>9}"
        lines.append(cells + ("" if good else "  MISSED"))
    return "\n".join(lines)


def _miss(item: Judged) -> str:
    """A wrongly answered session, with what made it hard."""
    session, far = item.case.session, item.case.separation
    if isinstance(session, DeltaSession):
        layout = session.layout
        place = (
            f"{layout.places} places, {len(layout.heights)} heights, {layout.cycles} cycles,"
            f" {1e3 * session.machine.noise:g} µm"
        )
    else:
        place = " ".join(effect.where for effect in session.effects)
    stands = ""
    if far:
        stands = f" {far.distance:.1f} from {far.nearest}, {far.visible:.1f} from healthy"
        stands += f", own {far.own:.1f}"
    also = ",".join(sorted(item.answer.mentioned - set(item.answer.ids)))
    said = f"{item.answer.verdict} {','.join(item.answer.ids)}" + (f" (or {also})" if also else "")
    return f"{item.case.name} [{item.kind}] {place}{stands}: {said} {item.answer.error or ''}"
