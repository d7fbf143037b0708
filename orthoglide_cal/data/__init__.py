"""Files to arrays and back: the only crossing. Everything is checked here, then trusted."""

from orthoglide_cal.data.atomic import write_text
from orthoglide_cal.data.cause_ids import CAUSE_IDS, CAUSE_UNITS
from orthoglide_cal.data.check import Check, check_file
from orthoglide_cal.data.machine_file import (
    default_machine,
    machine_text,
    read_machine,
    write_machine,
)
from orthoglide_cal.data.machine_schema import MachineModel
from orthoglide_cal.data.measured_file import read_input, read_measured
from orthoglide_cal.data.readings_csv import readings_csv
from orthoglide_cal.data.session_file import (
    read_session,
    session_json,
    session_readings,
    session_text,
    write_session,
)
from orthoglide_cal.data.session_of_readings import session_of_readings
from orthoglide_cal.data.session_schema import (
    RetakenReading,
    SessionGauge,
    SessionReading,
    SessionRecord,
    SkippedStep,
)

__all__ = [
    "CAUSE_IDS",
    "CAUSE_UNITS",
    "Check",
    "MachineModel",
    "RetakenReading",
    "SessionGauge",
    "SessionReading",
    "SessionRecord",
    "SkippedStep",
    "check_file",
    "default_machine",
    "machine_text",
    "read_input",
    "read_machine",
    "read_measured",
    "read_session",
    "readings_csv",
    "session_json",
    "session_of_readings",
    "session_readings",
    "session_text",
    "write_machine",
    "write_session",
    "write_text",
]
