"""The result of a verification: what was promised, what came true, how the machine responded."""

from __future__ import annotations

from dataclasses import dataclass

from orthoglide_cal.axes import Floats
from orthoglide_cal.measured import Source

AS_MODELLED = "as modelled"
OPPOSITE = "opposite sign"
EXCHANGED = "axes exchanged"
NO_RESPONSE = "no response"
OTHER_GAIN = "other gain"
UNDETERMINED = "undetermined"

PASS, FAIL, UNDECIDED = "pass", "fail", "undecided"


@dataclass(frozen=True)
class Deviation:
    """One difference before and after the correction [mm].

    Attributes:
        name: direction first, leg second, e.g. "x_y".
        before_mm: measured before.
        promised_mm: what the model said would remain.
        after_mm: measured after.
        expanded_mm: expanded uncertainty U of the value measured after.
    """

    name: str
    before_mm: float
    promised_mm: float
    after_mm: float
    expanded_mm: float


@dataclass(frozen=True)
class Coefficient:
    """A number with its 95 % Student-t interval; theory says 1."""

    value: float
    std: float
    low: float
    high: float

    @property
    def agrees(self) -> bool:
        """True if the interval holds 1."""
        return self.low <= 1.0 <= self.high


@dataclass(frozen=True)
class AxisResponse:
    """What one joint did.

    Attributes:
        axis: "x", "y" or "z".
        applied_mm: change entered in the controller.
        found_mm: change that the readings show.
        low_mm, high_mm: its 95 % interval.
        coefficient: found / applied; None where nothing was applied.
    """

    axis: str
    applied_mm: float
    found_mm: float
    low_mm: float
    high_mm: float
    coefficient: Coefficient | None

    @property
    def agrees(self) -> bool:
        """True if the interval holds what was applied."""
        return self.low_mm <= self.applied_mm <= self.high_mm


@dataclass(frozen=True)
class Change:
    """Did anything change that no joint offset explains?

    Attributes:
        rms_mm: root mean square of the unexplained change of a difference, per degree of freedom.
        noise_mm: what the gauge's noise alone gives for it.
        dof: degrees of freedom.
        p_value: probability of a larger one from noise alone.
    """

    rms_mm: float
    noise_mm: float
    dof: int
    p_value: float

    @property
    def found(self) -> bool:
        """True if noise alone would give such a change less than once in a thousand times."""
        return self.p_value < 0.001


@dataclass(frozen=True)
class Decision:
    """Conformity with a stated limit (decision rule in `decision.RULE`).

    Attributes:
        limit_mm: largest deviation allowed in any difference.
        outcome: "pass", "fail" or "undecided".
        largest_mm: largest deviation found, its size.
        largest: name of that difference.
        expanded_mm: expanded uncertainty U used as guard band.
    """

    limit_mm: float
    outcome: str
    largest_mm: float
    largest: str
    expanded_mm: float


@dataclass(frozen=True, eq=False)
class Verification:
    """A correction compared with its promise.

    Attributes:
        before, after: the data.
        machine: name.
        kind: what was compared: "readings", "six", "twelve" or "single".
        count: number of independent changes compared.
        applied_mm: what was entered in the controller, shape (3,).
        deviations: of each difference.
        rms_before_mm, rms_promised_mm, rms_after_mm: over those differences.
        response: coefficient of the change on the model's prediction.
        sigma_mm: standard deviation of one reading that its interval rests on.
        dof: degrees of freedom of the response's interval.
        axes: the same for each joint, fitted together.
        answer: one of the words above: how the machine responded.
        acted_as_mm: signed permutation of the applied offsets that explains the change better,
            shape (3,); None if what was applied explains it best.
        change: what no offset explains.
        remaining_mm: offsets found in the second session, shape (3,).
        remaining_expanded_mm: their expanded uncertainty, shape (3,).
        decision: about the limit; None without one.
        k: coverage factor of `Deviation.expanded_mm`.
    """

    before: Source
    after: Source
    machine: str
    kind: str
    count: int
    applied_mm: Floats
    deviations: tuple[Deviation, ...]
    rms_before_mm: float
    rms_promised_mm: float
    rms_after_mm: float
    response: Coefficient
    sigma_mm: float
    dof: int
    axes: tuple[AxisResponse, ...]
    answer: str
    acted_as_mm: Floats | None
    change: Change
    remaining_mm: Floats
    remaining_expanded_mm: Floats
    decision: Decision | None
    k: float
