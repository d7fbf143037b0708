"""The result of a diagnosis: a verdict, the accepted causes, what they gain, what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from orthoglide_cal.axes import Floats
from orthoglide_cal.machine import Estimate
from orthoglide_cal.measured import Source

CONSISTENT, NAMED, AMBIGUOUS, UNEXPLAINED = "consistent", "named", "ambiguous", "unexplained"


@dataclass(frozen=True)
class LackOfFit:
    """Does the offsets-only model explain the data to within this gauge's noise?

    Attributes:
        statistic: residual sum of squares over noise variance.
        dof: its degrees of freedom.
        p_value: probability of a larger one if nothing but noise is left.
        noise_mm: standard deviation of one reading that it was judged by.
        residual_mm: root mean square of the residuals per degree of freedom.
        repeats_mm: scatter of repeated readings; None without repeats. Repeats in sequence share
            one gauge set-up and understate the real scatter, so the verdict does not rest on it.
        repeats_p_value: chance that repeats of that scatter leave this residual (F test).
    """

    statistic: float
    dof: int
    p_value: float
    noise_mm: float
    residual_mm: float
    repeats_mm: float | None
    repeats_p_value: float | None


@dataclass(frozen=True)
class NamedCause:
    """A cause that the diagnosis accepts; several act together.

    Attributes:
        id: cause id of the contract.
        probability: posterior probability among all explanations tried.
        where: place in words ("" for the whole machine), e.g. "leg x, direction y".
        parameters: name → value with standard deviation, in the contract's unit.
        rms_before_mm, rms_after_mm: residuals of the fit without and with the cause.
        heldout_before_mm, heldout_after_mm: prediction errors on readings not fitted; None where
            nothing can be held out.
        heldout_ratio: held-out errors divided by what the extended model states for them, r.m.s.
        aliases: ids that explain the data as well at plausible sizes.
        advice: what a technician can do about it.
        in_machine: True if the cause is in the machine (not in the measurement).
        recommended: True if accepting it as an extension of the machine is recommended.
    """

    id: str
    probability: float
    where: str
    parameters: Mapping[str, Estimate]
    rms_before_mm: float
    rms_after_mm: float
    heldout_before_mm: float | None
    heldout_after_mm: float | None
    heldout_ratio: float | None
    aliases: tuple[str, ...]
    advice: str
    in_machine: bool
    recommended: bool


@dataclass(frozen=True)
class NextMeasurement:
    """The reading that would separate two explanations best.

    Attributes:
        what: instruction to the technician.
        separates: the two cause ids ("" stands for "no cause").
        separation_sigma: expected distance between their predictions, in standard deviations.
    """

    what: str
    separates: tuple[str, str]
    separation_sigma: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What the simulation gets wrong for one file.

    Attributes:
        source, kind, count, machine: the data and the machine.
        verdict: "consistent", "named", "ambiguous" or "unexplained".
        lack_of_fit: of the offsets-only model.
        causes: accepted ones, best first; empty for "consistent".
        ambiguous_with: ids that these data cannot separate from the answer.
        next_measurement: what would separate them; None if nothing is open.
        offsets_mm: under the accepted model, shape (3,).
        std_mm: standard deviations, shape (3,); carries the choice within an alias class.
        measured_mm: the readings (or differences), shape (n,).
        nominal_mm: prediction of the offsets-only model with fitted zeros, shape (n,).
        explained_mm: prediction of the accepted model, shape (n,).
        noise_mm: standard deviation of one reading under the accepted model.
        sensitivity: verdict and first cause with the tolerances halved and doubled,
            ("halved" | "doubled") → (verdict, id or "").
        ranking: every cause tried → posterior probability, best first.
        notes: sentences for the user.
    """

    source: Source
    kind: str
    count: int
    machine: str
    verdict: str
    lack_of_fit: LackOfFit
    causes: tuple[NamedCause, ...]
    ambiguous_with: tuple[str, ...]
    next_measurement: NextMeasurement | None
    offsets_mm: Floats
    std_mm: Floats
    measured_mm: Floats
    nominal_mm: Floats
    explained_mm: Floats
    noise_mm: float
    sensitivity: Mapping[str, tuple[str, str]]
    ranking: Mapping[str, float]
    notes: tuple[str, ...] = ()
