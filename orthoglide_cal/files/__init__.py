"""Files to arrays and back: the only crossing. Everything is checked here, then trusted."""

from orthoglide_cal.files.input import (
    Check,
    Input,
    check_file,
    latest_session,
    machine_in_folder,
    printer_settings,
    printers_in,
    read_input,
    sessions_in,
)
from orthoglide_cal.files.machine_file import (
    StoredMachine,
    default_machine,
    differing,
    machine_from_text,
    machine_text,
    machine_values,
    new_machine,
    new_machine_file,
    read_machine,
    read_machine_file,
    shipped_folder,
    shipped_machine,
    with_history,
)
from orthoglide_cal.files.printer_file import PrinterFile
from orthoglide_cal.files.probe_readings import places_csv, probe_points_csv
from orthoglide_cal.files.readings import (
    QUESTIONED,
    Conditions,
    GaugeIdentity,
    reading_rows,
    readings_csv,
    readings_of,
    row_at,
)
from orthoglide_cal.files.rows import ReadingRow
from orthoglide_cal.files.session_file import (
    Session,
    session_json,
    session_of_readings,
    session_text,
)
from orthoglide_cal.files.text import FileText, number_text, read_document, write_text
from orthoglide_cal.files.together import together
