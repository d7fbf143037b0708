"""Files to arrays and back: the only crossing. Everything is checked here, then trusted."""

from orthoglide_cal.data.cause_ids import CAUSE_IDS, CAUSE_UNITS
from orthoglide_cal.data.machine_file import (
    default_machine,
    machine_text,
    read_machine,
    write_machine,
)
from orthoglide_cal.data.measured_file import read_measured

__all__ = [
    "CAUSE_IDS",
    "CAUSE_UNITS",
    "default_machine",
    "machine_text",
    "read_machine",
    "read_measured",
    "write_machine",
]
