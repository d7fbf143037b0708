"""Planning: what to measure, before it is measured."""

from orthoglide_cal.planning.next_measurement import best_next, rank_measurements
