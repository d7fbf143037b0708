"""A gauge on a serial line or a USB-serial adapter, through pyserial."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from orthoglide_cal.errors import UsageError
from orthoglide_cal.planning.steps import SessionStep
from orthoglide_cal.session.asking import GaugeLost, Heard, LiveGauge
from orthoglide_cal.session.gauges.formats import Token, serial_format

if TYPE_CHECKING:
    import serial

_LINE = re.compile(r"(?P<format>\w+):(?P<port>[^#@]+)(?:@(?P<baud>\d+))?(?:#(?P<channels>[\w,]+))?")
_ENDS = b"\r\n\t"
# Longer than any token in use: what exceeds it is noise on the line.
_LONGEST = 120
# A token whose end does not follow within this time was cut off on its way [s].
PATIENCE_S = 1.0


class Splitter:
    """Cuts bytes into tokens at CR, LF or TAB; a token counts only if all of it has arrived."""

    def __init__(self) -> None:
        self._rest = b""
        self._since = 0.0
        self._headless = False

    def feed(self, data: bytes, now: float) -> list[str]:
        """Tokens completed by what arrived, blank ones left out; `now` is monotonic time [s]."""
        if data and not self._rest:
            self._since = now
        tokens: list[str] = []
        for byte in data:
            if byte in _ENDS:
                token = self._take()
                if token.strip():
                    tokens.append(token)
            else:
                self._rest += bytes((byte,))
                if len(self._rest) > _LONGEST:
                    self._rest, self._headless = b"", True
        return tokens

    def discard(self, data: bytes, now: float) -> None:
        """Forget everything up to now; of a token that is under way, its rest as well."""
        self.feed(data, now)
        self._headless = self._headless or bool(self._rest)
        self._rest = b""
        self._since = now

    def stale(self, now: float) -> str:
        """An unfinished token that is too old to be completed, else ""; it is thrown away."""
        if now - self._since <= PATIENCE_S:
            return ""
        token = self._take() if self._rest else ""
        self._headless = False
        return token

    def _take(self) -> str:
        token = "" if self._headless else self._rest.decode("ascii", errors="replace").strip("\0")
        self._rest, self._headless = b"", False
        return token


class SerialGauge(LiveGauge):
    """One serial line; with channels given, one of them per gauge set side by side."""

    def __init__(self, text: str) -> None:
        """
        Args:
            text: `FORMAT:PORT[@BAUD][#CHANNEL[,CHANNEL]]` from the command line.

        Raises:
            UsageError: anything else, or an unknown format.
        """
        match = _LINE.fullmatch(text)
        if match is None:
            serial_format(text)  # names the formats if it is not even one of them
            raise UsageError(
                f"The gauge {text!r} lacks its port.", f"Write it as {text}:/dev/ttyUSB0."
            )
        self.format = serial_format(match["format"])
        self.port = match["port"]
        self.baud = int(match["baud"] or self.format.baud)
        self.channels = match["channels"].split(",") if match["channels"] else []
        self.name = f"{self.format.name}:{self.port}"
        asked = self.format.request is not None
        self.hint = "press Return or the gauge's button" if asked else "press its button"
        check = f"Is it on, its cable plugged in, and set to {self.baud} baud?"
        self.silence = (
            f"The gauge on {self.port} did not answer. {check} Or press its button."
            if asked
            else f"Return cannot ask the gauge on {self.port}: press its button. Nothing? {check}"
        )
        self._splitter = Splitter()
        self._line: serial.Serial | None = None
        self._stand = 0

    def open(self) -> None:
        """Open the port, unless it is open.

        Raises:
            UsageError: pyserial is not installed.
            GaugeLost: the port is not there, or in use.
        """
        if self._line is not None:
            return
        try:
            import serial
        except ImportError as error:
            raise UsageError(
                "Serial gauges need pyserial.", "Install it: pip install 'orthocal[serial]'"
            ) from error
        try:
            self._line = serial.Serial(
                self.port, baudrate=self.baud, bytesize=self.format.data_bits,
                parity=self.format.parity, stopbits=self.format.stop_bits,
                timeout=0, write_timeout=1.0, exclusive=True,
            )  # fmt: skip
        except (OSError, ValueError) as error:
            raise GaugeLost(
                f"The gauge on {self.port} cannot be reached: {_reason(error)}.",
                "Check its cable, or end with q and resume with another --gauge.",
            ) from error
        self._splitter = Splitter()

    def begin(self, step: SessionStep, takes: int) -> None:
        """Only what is sent while its prompt is shown counts."""
        self._stand = step.stand
        if self._line is not None:
            with suppress(OSError, TypeError):  # the next poll reports it
                waiting = self._line.read(self._line.in_waiting)
                self._splitter.discard(waiting, time.monotonic())

    def poll(self, asked: bool) -> list[Heard]:
        """Tokens that arrived completely; `asked` sends the format's request, if it has one."""
        try:
            if self._line is None:
                raise OSError("it is not open")
            if asked and self.format.request:
                self._line.write(self.format.request)
            data = self._line.read(self._line.in_waiting or 1)
        except (OSError, TypeError) as error:  # pyserial: TypeError once the port has gone
            raise self._lost(error) from error
        now = time.monotonic()
        heard = [self._heard(raw) for raw in self._splitter.feed(data, now)]
        cut = self._splitter.stale(now)
        if cut:
            heard.append(Heard(Token(cut), self.name))
        return heard

    def reconnect(self) -> bool:
        """Try to open the port again, unless it is open."""
        with suppress(GaugeLost):
            self.open()
        return self._line is not None

    def close(self) -> None:
        """Close the port."""
        if self._line is not None:
            with suppress(OSError):
                self._line.close()
            self._line = None

    def _lost(self, error: Exception) -> GaugeLost:
        self.close()
        return GaugeLost(f"The gauge on {self.port} does not answer: {_reason(error)}.")

    def _heard(self, raw: str) -> Heard:
        token = self.format.parse(raw)
        if not self.channels or token.channel is None:
            return Heard(token, self.name)
        wanted = self.channels[min(self._stand, len(self.channels) - 1)]
        name = f"{self.name}#{token.channel}"
        if token.channel.lstrip("0") == wanted.lstrip("0"):
            return Heard(token, name)
        return Heard(token, name, f"That was channel {token.channel}; channel {wanted} is asked.")


class GaugePair(LiveGauge):
    """One line for each of the gauges that are read side by side."""

    def __init__(self, gauges: Sequence[SerialGauge]) -> None:
        self._gauges = gauges
        self._stand = 0
        self.hint, self.silence = gauges[0].hint, gauges[0].silence

    def begin(self, step: SessionStep, takes: int) -> None:
        """A prompt for the gauge of this step appears."""
        self._stand = min(step.stand, len(self._gauges) - 1)
        wanted = self._gauges[self._stand]
        self.hint, self.silence = wanted.hint, wanted.silence
        for gauge in self._gauges:
            gauge.begin(step, takes)

    def poll(self, asked: bool) -> list[Heard]:
        """What all gauges said; only the one that is wanted is asked, and counts."""
        heard: list[Heard] = []
        for number, gauge in enumerate(self._gauges):
            said = gauge.poll(asked and number == self._stand)
            if number != self._stand:
                other = f"That was gauge {number + 1}; gauge {self._stand + 1} is asked."
                said = [Heard(item.token, item.source, other) for item in said]
            heard += said
        return heard

    def reconnect(self) -> bool:
        """Try to open the ports that are closed."""
        back = [gauge.reconnect() for gauge in self._gauges]
        return all(back)

    def close(self) -> None:
        """Close all ports."""
        for gauge in self._gauges:
            gauge.close()


def _reason(error: Exception) -> str:
    """A short reason without the library's own wording around it."""
    if isinstance(error, OSError) and error.strerror and "Error" not in error.strerror:
        return error.strerror
    match = re.search(r"\] (.+?)(?:: '|$)", str(error))
    return match.group(1) if match else str(error).rstrip(".")
