"""The bench's result as text."""

from collections.abc import Sequence

from tests.truth import CAUSES

from .accuracy import Coverage, HeldOut
from .cases import KINDS
from .scoring import Judged, Rate, both_accepted, confusion, rates_by_label

SHORT = {
    "axis_gap": "gap",
    "axis_squareness": "squ",
    "leg_length": "leg",
    "encoder_scale": "sca",
    "backlash": "bkl",
    "thermal_drift": "thm",
    "bar_skew": "bar",
    "gauge_drift": "gdr",
    "stand_shift": "shf",
    "gauge_slip": "slp",
    "misread": "mis",
    "sign_flip": "flp",
    "swapped_gauges": "swp",
    "consistent": "OK",
    "unexplained": "?",
    "error": "ERR",
}


def rate_table(found: Sequence[Rate]) -> str:
    """Rates with what is demanded and the chance that a sound method falls short of it."""
    lines = [f"{'kind':<12}{'right':>7}{'of':>7}{'rate':>9}{'demanded':>10}{'false failure':>15}"]
    for rate in found:
        demanded = "-" if rate.required is None else f"{rate.required:.0%}"
        lines.append(
            f"{rate.kind:<12}{rate.right:>7}{rate.total:>7}{rate.share:>9.2%}{demanded:>10}"
            f"{rate.false_failure:>15.1e}" + ("" if rate.met else "  MISSED")
        )
    return "\n".join(lines)


def label_table(judged: Sequence[Judged]) -> str:
    """Right over all, by what was hidden and by kind."""
    lines = [f"{'hidden':<30}" + "".join(f"{kind:>11}" for kind in KINDS)]
    for label, kinds in rates_by_label(judged).items():
        cells = ("/".join(map(str, kinds[kind])) if kind in kinds else "" for kind in KINDS)
        lines.append(f"{label:<30}" + "".join(f"{cell:>11}" for cell in cells))
    accepted, total = both_accepted(judged)
    if total:
        lines.append(f"pairs with both members accepted, aliases not counted: {accepted}/{total}")
    return "\n".join(lines)


def confusion_table(judged: Sequence[Judged]) -> str:
    """Rows: what was hidden. Columns: the first cause named, or the verdict."""
    found = confusion(judged)
    columns = [*CAUSES, "consistent", "unexplained", "error"]
    lines = [f"{'hidden':<28}" + "".join(f"{SHORT[name]:>5}" for name in columns)]
    for label, counts in found.items():
        cells = (str(counts[name]) if counts[name] else "." for name in columns)
        lines.append(f"{label:<28}" + "".join(f"{cell:>5}" for cell in cells))
    return "\n".join(lines)


def coverage_table(found: Sequence[Coverage]) -> str:
    """Coverage of the offsets' 95 % intervals with the band of honest intervals."""
    lines = [f"{'hidden':<18}{'sessions':>9}{'coverage':>10}{'band of 93-97 %':>18}"]
    for row in found:
        lines.append(
            f"{row.label:<18}{row.sessions:>9}{row.share:>10.1%}{row.low:>10.1%} -{row.high:>6.1%}"
            + ("" if row.honest else "  MISSED")
        )
    return "\n".join(lines)


def heldout_table(found: Sequence[HeldOut], low: float, high: float) -> str:
    """r.m.s. ratios before and after the extension and as stated; after: `low` to `high`."""
    lines = [f"{'hidden':<18}{'sessions':>9}{'before':>9}{'after':>9}{'stated':>9}"]
    for row in found:
        good = all(low <= value <= high for value in (row.after, row.stated) if value is not None)
        stated = "-" if row.stated is None else f"{row.stated:.2f}"
        lines.append(
            f"{row.label:<18}{row.sessions:>9}{row.before:>9.2f}{row.after:>9.2f}{stated:>9}"
            + ("" if good else "  MISSED")
        )
    return "\n".join(lines)


def misses(groups: Sequence[tuple[str, Sequence[Judged]]], limit: int = 40) -> str:
    """The wrongly answered sessions, with what made them hard."""
    lines = []
    for name, judged in groups:
        for item in judged:
            if item.right:
                continue
            found = item.case.separation
            place = " ".join(effect.where for effect in item.case.session.effects)
            far = (
                f"{found.distance:.1f} from {found.nearest}, {found.visible:.1f} from healthy, "
                f"own {found.own:.1f}"
                if found
                else ""
            )
            said = f"{item.answer.verdict} {','.join(item.answer.ids)}"
            also = ",".join(sorted(item.answer.mentioned - set(item.answer.ids)))
            lines.append(
                f"{name} {item.case.name} [{item.kind}] {place} {far}: {said}"
                + (f" (or {also})" if also else "")
                + (f" {item.answer.error}" if item.answer.error else "")
            )
    more = [f"… and {len(lines) - limit} more"] if len(lines) > limit else []
    return "\n".join((*lines[:limit], *more))
