"""Planning: what to measure, before it is measured."""

from orthoglide_cal.planning.next_measurement import RankedMeasurement, best_next, ranked
from orthoglide_cal.planning.options import Option
