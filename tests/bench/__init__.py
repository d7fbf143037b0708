"""The blind bench: sessions with a hidden truth, the program's answers, and their rates."""

from .bench import Group, Setting, run_bench
from .cases import Counts
from .report import failures, full_report

__all__ = ["Counts", "Group", "Setting", "failures", "full_report", "run_bench"]
