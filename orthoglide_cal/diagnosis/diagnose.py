"""From what was measured to a verdict on the model: the main entry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import fdtrc

from orthoglide_cal.axes import Floats
from orthoglide_cal.causes import CAUSES, Acting, PatternCause, RelabelCause
from orthoglide_cal.diagnosis.assess import Assessment, assess
from orthoglide_cal.diagnosis.frame import Frame
from orthoglide_cal.diagnosis.gain import HeldOut, leave_out_cells, predict_later
from orthoglide_cal.diagnosis.posterior import DISMISSED, misfit
from orthoglide_cal.diagnosis.refine import Fitted
from orthoglide_cal.diagnosis.result import (
    AMBIGUOUS,
    CONSISTENT,
    NAMED,
    UNEXPLAINED,
    Diagnosis,
    LackOfFit,
    NamedCause,
    NextMeasurement,
)
from orthoglide_cal.diagnosis.separate import best_next
from orthoglide_cal.effects import Effect
from orthoglide_cal.errors import UnusableResultError
from orthoglide_cal.estimation.accuracy import scatter_of_repeats
from orthoglide_cal.machine import Estimate, Machine
from orthoglide_cal.measured import Differences, Measured, Readings

# A held-out error counts as lower if it falls below this share of the one before.
LOWER = 0.98


def diagnose(
    measured: Measured,
    machine: Machine,
    effects: Sequence[Effect] = (),
    holdout: Measured | None = None,
    applied: Floats | None = None,
    sensitivity: bool = False,
) -> Diagnosis:
    """Say what the offsets-only model gets wrong, if anything.

    Args:
        measured: readings or differences.
        machine: nominal machine, gauge and tolerances.
        effects: causes already accepted for this machine.
        holdout: later data that no fit may see.
        applied: offsets entered in the controller before the held-out data, shape (3,) [mm].
        sensitivity: also answer with all tolerances halved and doubled.

    Raises:
        RankDeficientError: the data do not determine the offsets.
        UnusableResultError: the numbers of the machine file and the data are too far apart.
    """
    try:
        return _diagnose(measured, machine, effects, holdout, applied, sensitivity)
    except np.linalg.LinAlgError as error:
        raise UnusableResultError(
            "These data cannot be weighed: the gauge's stated noise"
            f" ({machine.gauge.noise_mm:.2g} mm) is out of all proportion to the readings.",
            "Check gauge and tolerances in the machine file.",
        ) from error


def _diagnose(
    measured: Measured,
    machine: Machine,
    effects: Sequence[Effect],
    holdout: Measured | None,
    applied: Floats | None,
    sensitivity: bool,
) -> Diagnosis:
    frame = Frame.of(measured, machine, effects)
    found = assess(frame)
    verdict = found.answer.verdict
    nothing, accepted = found.fit(()), found.accepted
    later = None if holdout is None else Frame.of(holdout, machine, effects)
    between = np.zeros(3) if applied is None else np.asarray(applied, dtype=np.float64)

    def outside(fit: Fitted) -> HeldOut:
        if later is not None:
            return predict_later(later, fit, between)
        return leave_out_cells(frame, fit, accepted)

    causes: tuple[NamedCause, ...] = ()
    if verdict in (NAMED, AMBIGUOUS):
        before, after = outside(nothing), outside(accepted)
        causes = _named(found, before, after)
    offsets, std = found.offsets()
    values, nominal, explained = _pictures(frame, measured, nothing, accepted)
    changes = (
        {name: _brief(assess(frame, widen)) for name, widen in (("halved", 0.5), ("doubled", 2.0))}
        if sensitivity
        else {}
    )
    return Diagnosis(
        source=measured.source,
        kind=measured.kind,
        count=len(measured),
        machine=machine.name,
        verdict=verdict,
        lack_of_fit=_lack_of_fit(frame, measured, nothing),
        causes=causes,
        ambiguous_with=found.answer.ambiguous_with,
        next_measurement=_next(found),
        offsets_mm=offsets,
        std_mm=std,
        measured_mm=values,
        nominal_mm=nominal,
        explained_mm=explained,
        noise_mm=accepted.sigma,
        sensitivity=changes,
        ranking=_ranking(found),
        notes=_notes(found, measured),
    )


def _named(found: Assessment, before: HeldOut, after: HeldOut) -> tuple[NamedCause, ...]:
    frame, accepted, nothing = found.frame, found.accepted, found.fit(())
    probability = found.posterior.listed[found.answer.accepted]
    falls = after.rms_mm < LOWER * before.rms_mm

    def sure(id: str) -> bool:
        """No explanation without it needs a fault of the measurement in its place."""
        if found.answer.verdict == NAMED:
            return True
        without = [set(key) for key in found.posterior.rivals() if id not in key]
        instead = set().union(*without) - set(found.answer.accepted)
        return all(CAUSES[other].compensable for other in instead)

    start, named = 3, []
    for act in accepted.acting:
        spread = accepted.covariance[start : start + act.theta.size, :]
        spread = np.sqrt(np.diag(spread[:, start : start + act.theta.size]))
        fixed = isinstance(act.cause, PatternCause) and bool(act.cause.counts)
        start += 0 if fixed else act.theta.size
        stds = np.zeros(act.theta.size) if fixed else spread
        named.append(
            NamedCause(
                id=act.cause.id,
                probability=probability,
                where=act.cause.label(act.where, frame.plan, frame.machine),
                parameters={
                    name: Estimate(
                        act.cause.admissible(float(value)) / act.cause.scale,
                        float(std / act.cause.scale),
                        act.cause.unit,
                    )
                    for name, value, std in zip(act.cause.names, act.theta, stds, strict=False)
                },
                rms_before_mm=frame.rms(nothing.residual),
                rms_after_mm=frame.rms(accepted.residual),
                heldout_before_mm=before.rms_mm,
                heldout_after_mm=after.rms_mm,
                heldout_ratio=after.ratio,
                aliases=_aliases(found, act),
                advice=act.cause.advice,
                in_machine=act.cause.in_machine,
                recommended=act.cause.compensable and falls and sure(act.cause.id),
            )
        )
    # The cause without which the data would be hardest to explain comes first.
    alone = found.scores
    named.sort(key=lambda cause: -alone[(cause.id,)].log_evidence)
    return tuple(named)


def _aliases(found: Assessment, act: Acting) -> tuple[str, ...]:
    """Ids that stand in this cause's place in a rival explanation."""
    mine = set(found.answer.accepted) - {act.cause.id}
    aliases: list[str] = []
    for rival in found.posterior.rivals():
        if mine <= set(rival) and act.cause.id not in rival:
            aliases += [c for c in rival if c not in mine and c not in aliases]
    return tuple(aliases)


def _lack_of_fit(frame: Frame, measured: Measured, nothing: Fitted) -> LackOfFit:
    noise = frame.machine.gauge.noise_mm
    total = float(nothing.residual @ nothing.residual)
    dof = len(frame) - 3
    repeats = (
        scatter_of_repeats(measured.plan, measured.value)
        if isinstance(measured, Readings)
        else None
    )
    chance = None
    if repeats is not None and repeats.sigma_mm > 0.0 and dof > repeats.dof:
        pure = repeats.dof * repeats.sigma_mm**2
        lack = max(total - pure, 0.0) / (dof - repeats.dof)
        chance = float(fdtrc(dof - repeats.dof, repeats.dof, lack / repeats.sigma_mm**2))
    return LackOfFit(
        statistic=total / noise**2,
        dof=dof,
        p_value=misfit(total, dof, noise),
        noise_mm=noise,
        residual_mm=float(np.sqrt(total / dof)) if dof else 0.0,
        repeats_mm=None if repeats is None else repeats.sigma_mm,
        repeats_p_value=chance,
    )


def _pictures(
    frame: Frame, measured: Measured, nothing: Fitted, accepted: Fitted
) -> tuple[Floats, Floats, Floats]:
    """Measured values, the offsets-only prediction and the accepted one, shape (m,) [mm].

    In the order of the file.
    """
    if isinstance(measured, Differences):
        order = [frame.names.index(name) for name in measured.names]
        data, left = measured.value, [(frame.root @ f.residual)[order] for f in (nothing, accepted)]
    else:
        data, left = measured.value, [frame.matrix.T @ f.residual for f in (nothing, accepted)]
        for act in accepted.acting:
            if isinstance(act.cause, RelabelCause) and act.cause.reversible(frame.plan, act.where):
                index, sign = act.cause.relabel(frame.plan, act.where)
                left[1] = sign * left[1][index]
    return data, data - left[0], data - left[1]


def _next(found: Assessment) -> NextMeasurement | None:
    if found.answer.verdict != AMBIGUOUS:
        return None
    rival = next(key for key in found.posterior.rivals() if set(key) - set(found.answer.accepted))
    return best_next(found.frame, found.accepted, found.fit(rival))


def _brief(found: Assessment) -> tuple[str, str]:
    return found.answer.verdict, "+".join(found.answer.accepted)


def _ranking(found: Assessment) -> Mapping[str, float]:
    listed = {"+".join(key): value for key, value in found.posterior.listed.items()}
    both = {**listed, **found.posterior.unlisted}
    return dict(sorted(both.items(), key=lambda item: -item[1]))


def _notes(found: Assessment, measured: Measured) -> tuple[str, ...]:
    notes = list(measured.remarks)
    answer, causes = found.answer, found.accepted.acting
    if answer.verdict == CONSISTENT and answer.ambiguous_with:
        notes.append(
            "Of plausible size yet too small to be seen in these readings:"
            f" {', '.join(answer.ambiguous_with)}."
        )
    if answer.verdict == UNEXPLAINED:
        unlisted = found.posterior.unlisted
        pattern = max(unlisted, key=lambda name: unlisted[name])
        notes.append(f"No listed cause explains the residuals. Their pattern: {pattern}.")
        notes.append("Its size is part of the uncertainty of the offsets.")
    listed = found.posterior.listed
    for part in (key for key in listed if key and set(key) < set(answer.accepted)):
        if listed[part] >= DISMISSED * listed[answer.accepted]:
            rest = "+".join(cause for cause in answer.accepted if cause not in part)
            notes.append(
                f"{part[0]} alone is possible, too (probability {listed[part]:.2g}): whether {rest}"
                " acts beside it is not certain."
            )
    if isinstance(measured, Differences) and causes:
        unknowns = sum(len(act.cause.names) for act in causes)
        spare = len(measured) - 3
        notes.append(
            f"{len(measured)} differences leave {spare} numbers beyond the three offsets, and this"
            f" answer has {unknowns} unknowns: the name rests on plausible sizes, not on the data"
            " alone. Raw readings, with more postures, carry more."
        )
    if any(isinstance(act.cause, PatternCause) for act in causes) and isinstance(
        measured, Readings
    ):
        notes.append("A fault of the measurement is mended by measuring, not by the controller.")
    return tuple(notes)
