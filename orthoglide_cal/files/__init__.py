"""Files to arrays and back: the only crossing. Everything is checked here, then trusted."""

from orthoglide_cal.files.input import (
    Check,
    FoundSession,
    Input,
    check_file,
    latest_session,
    read_input,
    sessions_in,
)
from orthoglide_cal.files.machine_file import (
    default_machine,
    machine_from_text,
    machine_text,
    machine_values,
    read_machine,
)
from orthoglide_cal.files.readings import Conditions, GaugeIdentity, readings_csv
from orthoglide_cal.files.session_file import (
    session_json,
    session_of_readings,
    session_text,
    write_session,
)
from orthoglide_cal.files.text import parse_number, write_text

__all__ = [
    "Check",
    "Conditions",
    "FoundSession",
    "GaugeIdentity",
    "Input",
    "check_file",
    "default_machine",
    "latest_session",
    "machine_from_text",
    "machine_text",
    "machine_values",
    "parse_number",
    "read_input",
    "read_machine",
    "readings_csv",
    "session_json",
    "session_of_readings",
    "session_text",
    "sessions_in",
    "write_session",
    "write_text",
]
