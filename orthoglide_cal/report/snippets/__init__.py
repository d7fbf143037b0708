"""What goes to the controller, in its formats."""

from orthoglide_cal.report.snippets.linuxcnc import linuxcnc
from orthoglide_cal.report.snippets.plain import plain_text
from orthoglide_cal.report.snippets.structured import as_json, as_yaml
from orthoglide_cal.report.snippets.tables import compensation_csv, offsets_csv

__all__ = ["as_json", "as_yaml", "compensation_csv", "linuxcnc", "offsets_csv", "plain_text"]
