"""Offsets as lines for a LinuxCNC configuration, to be pasted by hand.

The file itself is never rewritten: its repeated keys and comments would not survive.
"""

from __future__ import annotations

from orthoglide_cal.outcome.export import Export
from orthoglide_cal.report.numbers import plain, signed, two_figures
from orthoglide_cal.report.shown import in_comment
from orthoglide_cal.report.snippets.instructions import after_entering, head


def linuxcnc(export: Export) -> str:
    """Comments and one [JOINT_n] section per axis; true position = indicated + HOME_OFFSET."""
    decimals = export.adjustment.decimals
    lines = [f"# {in_comment(line)}" for line in head(export)]
    lines += [
        "#",
        "# HOME_OFFSET takes the joint offset with its sign, in mm (divide by 25.4 if LINEAR_UNITS",
        "# is inch). If yours holds more than the offset, such as the place of the home switch,",
        "# add the change to it instead of replacing it.",
    ]
    for number, joint in enumerate(export.adjustment.joints):
        lines += [
            "",
            f"[JOINT_{number}]",
            f"# axis {joint.axis}: previous {signed(joint.previous_mm, decimals)},"
            f" change {signed(joint.change_mm, decimals)} (U = {two_figures(joint.expanded_mm)})",
            f"HOME_OFFSET = {plain(joint.new_mm, decimals)}",
        ]
    lines.append("")
    lines += [f"# {in_comment(line)}" for line in after_entering(export)]
    return "\n".join(lines) + "\n"
