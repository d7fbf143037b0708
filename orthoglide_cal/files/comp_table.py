"""LinuxCNC's table of a joint, `COMP_FILE`: what it adds to the motor, over position and direction.

Type 1: lines of three numbers, ascending: position, what is added moving +, and moving -. Between
lines it is linear, beyond the first and last it stays. With a table `BACKLASH` is ignored. A joint
with a switch counts from what the table adds there, a joint homed at once does not: a table that is
zero at HOME_OFFSET, in the direction in which the switch is latched, means the same to both.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.files.text import read_bytes
from orthoglide_cal.model.machine import WrittenTable, WrittenValue
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.words import plain

# What is read of a [JOINT_n] besides its home offset; what is not there counts as 0.
FILE, TYPE, BACKLASH = WRITTEN = ("COMP_FILE", "COMP_FILE_TYPE", "BACKLASH")
OPTIONS = (*WRITTEN, "HOME_SEARCH_VEL", "HOME_LATCH_VEL", "MIN_LIMIT", "MAX_LIMIT")
_MOST_LINES = 256
_FARTHEST_MM = 1e5
_BEYOND_MM = 1000.0  # half the length of a table where no limits are given

# What is to be added over joint positions (n,), moving + and moving -, shape (2, n) [mm].
Added = Callable[[Floats], Floats]


@dataclass(frozen=True)
class JointTable:
    """What an INI says of one joint; `options` are the lines that stand there."""

    target: str  # path of the INI
    home: WrittenValue
    options: Mapping[str, WrittenValue]
    unit_mm: float

    def _number(self, option: str) -> float:
        return float(self.options[option].before) if option in self.options else 0.0

    @property
    def limits_mm(self) -> tuple[float, float] | None:
        """Lowest and highest position; None where there are none, such as 1e99."""
        low, high = (self.unit_mm * self._number(option) for option in ("MIN_LIMIT", "MAX_LIMIT"))
        return (low, high) if -_FARTHEST_MM < low < high < _FARTHEST_MM else None

    def origin_mm(self, home_mm: float) -> float | None:
        """Machine's joint value where this joint says 0: it counts either from there, or from the
        isotropic posture. None where its limits do not tell which."""
        low, high = self.limits_mm or (0.0, 0.0)
        inside = [low < at < high for at in (home_mm, 0.0)]
        return {(True, False): 0.0, (False, True): home_mm}.get((inside[0], inside[1]))

    def _existing(self) -> Floats:
        """Rows of the table that stands there, or that stands for BACKLASH, (n, 3) [its unit]."""
        half, line = 0.5 * self._number(BACKLASH), self.options.get(FILE)
        if line is None:
            return np.array([[float(self.home.before), half, -half]])
        path = Path(self.target).parent / line.before
        rows: list[list[float]] = []
        for number, text in enumerate(read_bytes(str(path)).decode("latin-1").splitlines(), 1):
            try:
                row = [float(word) for word in text.split()]
                if len(row) != 3 or not np.isfinite(row).all() or (rows and row[0] <= rows[-1][0]):
                    raise ValueError
            except ValueError:
                problem = (
                    "LinuxCNC ignores this line, or the rest: not 3 numbers, or not ascending."
                )
                remedy = "Correct the table, or remove COMP_FILE from the INI."
                raise InputError(problem, remedy, file=str(path), line=number, value=text) from None
            rows.append(row)
        if not rows:
            raise InputError("The table is empty.", "Remove COMP_FILE.", file=str(path))
        table = np.array(rows)
        if self._number(TYPE) == 0.0:  # it has the positions that were reached
            table[:, 1:] = table[:, :1] - table[:, 1:]
        return table

    def changed(
        self, added: Added, amount_mm: float, decimals: int
    ) -> tuple[list[WrittenValue], WrittenTable]:
        """Lines of the INI, and a new table beside it, that add this correction to what is there.

        Args:
            added: what cancels the error of the joint; by its own position.
            amount_mm: joint offset to be entered with it.
            decimals: of HOME_OFFSET.

        Raises:
            InputError: the table that stands there is not as LinuxCNC reads it.
            UsageError: it would be longer than LinuxCNC takes.
        """
        unit, table = self.unit_mm, self._existing()
        old = float(self.home.before)
        latch, search = self._number("HOME_LATCH_VEL"), self._number("HOME_SEARCH_VEL")
        way = 1 if latch < 0.0 else 0

        def stands(at: Floats) -> Floats:
            return np.stack([np.interp(at, table[:, 0], table[:, k]) for k in (1, 2)])

        # True position at the switch, or where a joint without one is homed.
        here = np.array([old])
        home = old + (amount_mm - float(added(here * unit)[way, 0])) / unit
        if latch == search == 0.0:
            home -= float(stands(here)[way, 0])
        home = round(home, min(decimals, 6))
        ends = self.limits_mm or (home * unit - _BEYOND_MM, home * unit + _BEYOND_MM)
        # What stands there belongs to the screw, which a new home offset counts otherwise.
        table[:, 0] += home - old
        at = np.unique(np.round([*table[:, 0], *(end / unit for end in ends), home, old], 6))
        values = stands(at) + added(at * unit) / unit
        values = np.round(values - values[way, at == home], 8) + 0.0  # no negative zero
        rows = np.column_stack([at, *values]).tolist()
        if len(rows) > _MOST_LINES:
            problem = f"The table of this joint would have {len(rows)} lines; LinuxCNC takes 256."
            raise UsageError(problem, f"Shorten {self.options[FILE].before}.")
        text = "".join("{:.6f} {:.8f} {:.8f}\n".format(*row) for row in rows)
        digest = hashlib.sha256(text.encode()).hexdigest()
        section = self.home.key.partition("]")[0] + "]"
        name = f"{section[1:-1].lower()}-{digest[:8]}.comp"
        moved = {BACKLASH: "0"} if BACKLASH in self.options and FILE not in self.options else {}
        wanted = {FILE: name, TYPE: "1"} | moved
        new = [self.home.changed(after=plain(home, decimals))]
        for option, after in wanted.items():
            # A new line stands above the home offset, where a line surely ends.
            above = WrittenValue(line=self.home.line, key=f"{section} {option}")
            line = self.options.get(option, above)
            if line.before != after:
                new.append(line.changed(after=after))
        path = str(Path(self.target).parent / name)
        return new, WrittenTable(path=path, sha256=digest, text=text)
