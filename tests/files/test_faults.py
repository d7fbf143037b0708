"""Every fault of a file is named with its place and a remedy; the cases stand in `faults.yaml`."""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from orthoglide_cal.files.controller_file import controller_file
from orthoglide_cal.files.input import read_input
from orthoglide_cal.files.machine_file import read_machine_file
from orthoglide_cal.files.readings import session_text
from tests import firmware_files as made
from tests.printer_files import OFF

from .helpers import MODEL, problems, saved, table
from .test_controller_file import CFG, INI
from .test_firmware_files import CONSOLE, G29, M503
from .test_firmware_files import PRINTER as KNOWN
from .test_machine_file import HISTORY, PRINTER, TEXT, accepted, text_with
from .test_printer_file import GOOD
from .test_probe_readings import MODEL as WITH_BED
from .test_probe_readings import cfg
from .test_readings import HEAD, PARTED, WITH_PARTS
from .test_session_file import values, without

CASES = table("faults.yaml")
Reader = Callable[[str], object]
of_gauges, of_probes = (partial(read_input, model=model) for model in (MODEL, WITH_BED))
of_printer = partial(read_input, model=KNOWN)
of_mesh, of_calibration = (partial(read_input, stored=kind) for kind in ("mesh", "calibration"))
WITHOUT_RADIUS = re.sub(".*delta_radius.*\n", "", CFG)
SILENT = made.g33(made.UNEVEN, OFF, results=False)
SESSION = session_text(values())

# Of each kind: a sound file, its name, and how it is read.
KINDS: dict[str, tuple[str, str, Reader]] = {
    "readings": (f"{HEAD}\nx,iso,y,0.1\nx,max,y,0.2\n", "r.csv", of_gauges),
    "parts": ("\n".join((WITH_PARTS, *PARTED)), "r.csv", of_gauges),
    "differences": ("difference,value_mm\nx_y,0.1\nx_z,0.1\n", "d.csv", of_gauges),
    "touches": ("x_mm,y_mm,reading_mm\n0,0,0.1\n1,2,0.2\n", "t.csv", of_probes),
    "session": (SESSION, "s.yaml", of_gauges),
    "session, its own machine": (SESSION, "s.yaml", read_input),
    "session without minutes": (without(SESSION, "minutes"), "s.yaml", of_gauges),
    "machine": (TEXT + HISTORY, "m.yaml", read_machine_file),
    "machine with causes": (
        text_with(accepted(), accepted("backlash")), "m.yaml", read_machine_file
    ),
    "printer": (PRINTER, "m.yaml", read_machine_file),
    "klipper": (GOOD, "printer.cfg", read_input),
    "klipper, its mesh": (GOOD, "printer.cfg", of_mesh),
    "calibration and mesh": (cfg(), "printer.cfg", read_input),
    "mesh": (cfg("m"), "printer.cfg", read_input),
    "nothing stored": (cfg(""), "printer.cfg", read_input),
    "nothing stored, mesh": (cfg(""), "printer.cfg", of_mesh),
    "nothing stored, calibration": (cfg(""), "printer.cfg", of_calibration),
    "settings of firmware": (made.config_g(made.UNEVEN), "config.g", read_input),
    "Marlin": (M503, "c.txt", read_input),
    "Marlin, its touches": (M503 + G29, "c.txt", read_input),
    "Marlin, G33 in silence": (M503 + SILENT, "c.txt", read_input),
    "a known printer": (CONSOLE, "c.txt", of_printer),
    "mill": (INI, "mill.ini", controller_file),
    "kossel": (CFG, "printer.cfg", controller_file),
    "kossel without radius": (WITHOUT_RADIUS, "printer.cfg", controller_file),
}  # fmt: skip


@pytest.mark.parametrize(("kind", "row"), [(kind, row) for kind in CASES for row in CASES[kind]])
def test_faults_name_place_and_remedy(tmp_path: Path, kind: str, row: list[Any]) -> None:
    """A row states the first of them."""
    old, new, line, column, value, what, remedy, *count = row
    sound, name, read = KINDS[kind]
    assert old is None or old in sound
    path = saved(tmp_path, new if old is None else sound.replace(old, new, 1), name)
    faults = problems(read, path)
    assert [len(faults)] == (count or [1])
    fault = faults[0]
    assert (fault.file, fault.line, fault.column, fault.value) == (path, line, column, value)
    assert what in fault.what
    assert fault.remedy
    assert remedy in fault.remedy
