"""Planning: what to measure, before it is measured."""

from orthoglide_cal.planning.next_reading import Next, best_next, ranked
from orthoglide_cal.planning.options import Option, joined

__all__ = ["Next", "Option", "best_next", "joined", "ranked"]
