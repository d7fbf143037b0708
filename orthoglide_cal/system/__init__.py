"""Differences between operating systems: terminal, lock, giving a file its name."""

from orthoglide_cal.system.chosen import SYSTEM
from orthoglide_cal.system.interface import Terminal
