"""`orthocal plan --program`: the posture program or the places to probe, shown or written."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from orthoglide_cal.cli import common
from orthoglide_cal.errors import UsageError

if TYPE_CHECKING:
    from orthoglide_cal.files.gcode_template import Template
    from orthoglide_cal.planning.forecast import SessionForecast
    from orthoglide_cal.planning.program import PostureProgram

_GCODE = (".nc", ".ngc", ".gcode", ".tap", ".cnc")
_CSV = ".csv"


def write_program(program: PostureProgram, target: Path, template: Path | None = None) -> None:
    """Write a posture program; "-" shows its table on standard output.

    Args:
        program: what to write.
        target: CSV or G-code, by the end of its name; an existing file is not touched.
        template: of the G-code; the one of `orthocal template gcode` if None.

    Raises:
        UsageError: another kind of file, a template without G-code, or the file exists.
        InputError: the template cannot be used, or the file cannot be written.
    """
    from orthoglide_cal.report import program as texts

    form = _CSV if str(target) == "-" else target.suffix.lower()
    if template is not None and form not in _GCODE:
        raise UsageError("--template is for G-code.", f"Name a file that ends in {_GCODE[0]}.")
    if form == _CSV:
        text = texts.program_csv(program)
    elif form in _GCODE:
        text = texts.program_gcode(program, _template(program, template))
    else:
        raise _unknown(target, f"End it in {_CSV} for a table, in {_GCODE[0]} for G-code.")
    said = "Try them first without gauges, slowly, a hand at the stop."
    _write(text, target, f"{len(program.blocks)} blocks written to {target}. {said}")


def _template(program: PostureProgram, path: Path | None) -> Template:
    from importlib.resources import as_file, files

    from orthoglide_cal.files.gcode_template import gcode_template
    from orthoglide_cal.files.text import YAML_LIMIT, read_document

    with as_file(files("orthoglide_cal.files") / "templates" / "gcode.nc") as shipped:
        document = read_document(str(path or shipped), YAML_LIMIT)
    return gcode_template(document, [block.number for block in program.blocks])


def write_places(found: SessionForecast, target: Path) -> None:
    """Write the places of a layout as a file to be filled in; "-" shows it.

    Raises:
        UsageError: another kind of file, a layout with distances, or the file exists.
    """
    from orthoglide_cal.files import places_csv
    from orthoglide_cal.model.probe_plan import ProbePlan

    if not found.can_be_sent:
        raise UsageError(
            f"{found.name} holds distances on a printed object: they are not probed.",
            "Print and measure what Klipper's DELTA_ANALYZE asks for, and bring printer.cfg; or"
            " choose a layout without distances: --layout bed-13",
        )
    if str(target) != "-" and target.suffix.lower() != _CSV:
        raise _unknown(target, f"End it in {_CSV}: places to probe are a table.")
    said = "Fill in reading_mm, the height at which the probe triggers, bed mesh off."
    told = f"{len(found.plan)} places written to {target}: {found.what}. {said}"
    _write(places_csv(ProbePlan.require(found.plan)), target, told)


def _write(text: str, target: Path, told: str) -> None:
    """A file, of which people are told; or "-"."""
    from orthoglide_cal.files import write_text

    if str(target) == "-":
        print(text, end="")
        return
    write_text(target, text)
    common.tell(told)


def _unknown(target: Path, remedy: str) -> UsageError:
    return UsageError(f"What {target} is to be cannot be told from its name.", remedy)
