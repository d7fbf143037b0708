"""An independent truth: measured sessions of machines with something hidden in them."""

from .effects import CAUSES, Effect
from .forward import MACHINE_CAUSES, signals
from .machines import (
    DIAL,
    GAUGES,
    LARGE,
    MACHINES,
    MICRON,
    PROTOTYPE,
    TOLERANCES,
    Gauge,
    Machine,
    machine_yaml,
)
from .outside import OUTSIDE
from .plan import Plan, standard_plan
from .separation import (
    HEALTHY,
    Separation,
    all_pairs,
    clear_outside,
    expected_heldout,
    pair_distances,
    separation,
)
from .session import (
    Session,
    again,
    continue_session,
    make_session,
    measure,
    readings_csv,
    second_session,
    write_readings,
)
