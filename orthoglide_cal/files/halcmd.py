"""The home offsets of a LinuxCNC that runs on this computer: `ini.N.home_offset`, by `halcmd`.

They take effect at the next homing; the unit is that of its INI.
"""

from __future__ import annotations

import subprocess
from collections.abc import Sequence

from orthoglide_cal.errors import InputError
from orthoglide_cal.model import AXES


def live_offsets() -> tuple[float, ...] | None:
    """The offset of each joint; None if no LinuxCNC runs here."""
    try:
        return tuple(float(_halcmd("getp", joint)) for joint in range(len(AXES)))
    except (OSError, subprocess.SubprocessError, ValueError):
        return None


def set_live_offsets(texts: Sequence[str]) -> None:
    """Set the offset of each joint. Raises InputError."""
    try:
        for joint, text in enumerate(texts):
            _halcmd("setp", joint, text)
    except (OSError, subprocess.SubprocessError) as error:
        raise InputError(
            "The running LinuxCNC does not take the offsets; its INI holds them.",
            "Restart LinuxCNC, then home.",
        ) from error


def _halcmd(what: str, joint: int, *value: str) -> str:
    command = ["halcmd", what, f"ini.{joint}.home_offset", *value]
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=5.0)
    return run.stdout.strip()
