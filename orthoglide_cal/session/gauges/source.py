"""Where readings come from besides the keyboard: what the session's loop needs of any gauge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from orthoglide_cal.errors import OrthocalError
from orthoglide_cal.session.gauges.token import Token
from orthoglide_cal.session.steps import Step


class GaugeLost(OrthocalError):
    """The gauge does not answer any more: unplugged, switched off, or the port is in use."""

    exit_code = 3


@dataclass(frozen=True)
class Heard:
    """Something that a gauge said at a prompt.

    Attributes:
        token: the message.
        source: which gauge, for the records.
        elsewhere: a sentence if it was not the gauge that is asked; its value is not used.
    """

    token: Token
    source: str
    elsewhere: str = ""


class Gauge(Protocol):
    """A source of readings."""

    hint: str
    """What to do for a reading, e.g. "press the gauge's button"."""

    def begin(self, step: Step, takes: int) -> None:
        """A prompt for this step appears: forget what was said before.

        Args:
            step: the reading wanted.
            takes: readings of this step that arrived earlier.
        """

    def request(self) -> None:
        """Return was pressed: ask for a reading, if the gauge can be asked."""

    def poll(self) -> list[Heard]:
        """What was said since the last call; returns at once. Raises GaugeLost."""

    def reconnect(self) -> bool:
        """After GaugeLost: try again; True if it is back."""

    def close(self) -> None:
        """Let go of the port."""
