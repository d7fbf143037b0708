"""Files to arrays and back: the only crossing. Everything is checked here, then trusted."""

from orthoglide_cal.files.input import (
    Check,
    FoundSession,
    Input,
    check_file,
    latest_session,
    machine_in_folder,
    read_input,
    sessions_in,
)
from orthoglide_cal.files.machine_edit import new_machine, with_history
from orthoglide_cal.files.machine_file import (
    LARGEST_OFFSET_MM,
    StoredMachine,
    default_machine,
    differing,
    machine_from_text,
    machine_text,
    machine_values,
    read_machine,
    read_machine_file,
    shipped_folder,
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
    "LARGEST_OFFSET_MM",
    "Check",
    "Conditions",
    "FoundSession",
    "GaugeIdentity",
    "Input",
    "StoredMachine",
    "check_file",
    "default_machine",
    "differing",
    "latest_session",
    "machine_from_text",
    "machine_in_folder",
    "machine_text",
    "machine_values",
    "new_machine",
    "parse_number",
    "read_input",
    "read_machine",
    "read_machine_file",
    "readings_csv",
    "session_json",
    "session_of_readings",
    "session_text",
    "sessions_in",
    "shipped_folder",
    "with_history",
    "write_session",
    "write_text",
]
