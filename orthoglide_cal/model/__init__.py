"""What every gauge reads: plan, rails, causes, the forward model; tool error and compensation."""

from orthoglide_cal.model.cause import Cause, Effect, Estimate, Place, Stage
from orthoglide_cal.model.gauge_doubts import gauge_doubts
from orthoglide_cal.model.machine import Entered, Machine
from orthoglide_cal.model.measured import (
    DIFFERENCES,
    DataKind,
    Difference,
    Differences,
    Excerpt,
    Measured,
    Readings,
    Source,
    weighing,
)
from orthoglide_cal.model.model import (
    Model,
    carried_uncertainty,
    differentiate,
    differentiate_each,
    simulate,
    simulate_with_jacobian,
)
from orthoglide_cal.model.orthoglide import (
    Gauge,
    double_posture,
    ideal_plan,
    reduction,
    single_posture,
    visiting,
)
from orthoglide_cal.model.plan import (
    Floats,
    Ints,
    Numbers,
    Plan,
    ReadOnly,
    cell_contrasts,
    known_plan,
    without_zeros,
    zero_free,
)
from orthoglide_cal.model.readings import (
    AXES,
    Contact,
    GaugePlan,
    Posture,
    Series,
    number_setups,
    other_axes,
)
