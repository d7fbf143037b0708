"""When something arrives too soon to be meant: second presses, and gauges that never stop.

After a reading, its source is deaf for a while. What arrives meanwhile is never a reading nor an
answer, and begins the while anew, so that a gauge that sends all the time is never listened to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

# A button pressed twice, or bouncing, is over by then; reading the other dial takes longer [s].
BETWEEN_GAUGES_S = 1.2
# No machine is driven to another posture sooner [s].
AFTER_A_DRIVE_S = 2.0
# So many messages in a row that nobody asked for come from a gauge that sends by itself.
STREAM = 4
# So many that come at intervals equal to within this [s] are not pressed by anybody.
EVEN_S = 0.15
# A gauge, or one that acts as a keyboard, is faster [s per character], a hand is not.
BY_HAND_S = 0.06
# And a hand needs so long to come back to the keys [s].
BACK_AT_THE_KEYS_S = 0.3


@dataclass(eq=False)
class DeadTime:
    """Of one source, the keyboard or the gauges; all times are monotonic [s]."""

    unasked: int = 0  # messages in a row that came too soon
    after_reading: bool = False  # whether the first of them followed a reading from this source
    _last: float = -math.inf  # the last reading or message
    _opens: float = -math.inf
    _arrivals: dict[float, bool] = field(default_factory=dict)  # of messages; was it a reading

    def begin(self, at: float, driving: bool, mine: bool) -> None:
        """A reading arrived, from this source if `mine`; the machine may be driven now."""
        self.unasked, self.after_reading, self._last = 0, mine, at
        wait = AFTER_A_DRIVE_S if driving else BETWEEN_GAUGES_S
        self._opens = max(self._opens, at + wait)

    def is_early(self, begun: float, ended: float, length: int, shown: float) -> bool:
        """Whether a message cannot be meant for what is asked.

        Args:
            begun, ended: when its first character arrived, and its end.
            length: number of characters; 0 if they were not typed.
            shown: since when the question stands on the screen.
        """
        by_hand = 0 < length * BY_HAND_S <= ended - begun
        opens = self._last + BACK_AT_THE_KEYS_S if by_hand else self._opens
        return begun < max(opens, shown)

    def ignore(self, at: float) -> float | None:
        """A message was too soon; the time since the last one [s], None if only its prompt was."""
        gone = at - self._last if at < self._opens else None
        if gone is None:
            self.unasked, self.after_reading = 0, False
        self.unasked += 1
        self._last, self._opens = at, max(self._opens, at + BETWEEN_GAUGES_S)
        return gone

    def arrived(self, at: float) -> int | None:
        """A message came from a gauge: how many of the last ones, all evenly spaced, were readings.

        None if they are not evenly spaced, or too few.
        """
        self._arrivals = {**dict(list(self._arrivals.items())[1 - STREAM :]), at: False}
        gaps = [late - early for early, late in pairwise(self._arrivals)]
        if len(gaps) < STREAM - 1 or max(gaps) - min(gaps) > EVEN_S:
            return None
        if min(gaps) < 5.0 * EVEN_S:  # faster ones come too soon anyway
            return None
        readings = sum(self._arrivals.values())
        self._arrivals = dict.fromkeys(self._arrivals, False)
        self._opens = max(self._opens, at + 2.0 * max(gaps))
        return readings

    def was_reading(self, at: float) -> None:
        """The message of that time became a reading."""
        if at in self._arrivals:
            self._arrivals[at] = True

    def is_quiet(self, now: float) -> bool:
        """Whether whatever came too soon has ended."""
        return now >= self._opens
