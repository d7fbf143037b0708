"""A gauge on a serial line or a USB-serial adapter, through pyserial."""

from __future__ import annotations

import re
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from orthoglide_cal.errors import UsageError
from orthoglide_cal.session.gauges.registry import serial_format
from orthoglide_cal.session.gauges.source import GaugeLost, Heard
from orthoglide_cal.session.gauges.splitter import Splitter
from orthoglide_cal.session.gauges.token import Format, Token
from orthoglide_cal.session.steps import Step

if TYPE_CHECKING:
    import serial

_SPEC = re.compile(r"(?P<format>\w+):(?P<port>[^#@]+)(?:@(?P<baud>\d+))?(?:#(?P<channels>[\w,]+))?")


@dataclass(frozen=True)
class PortSpec:
    """`FORMAT:PORT[@BAUD][#CHANNEL[,CHANNEL]]` from the command line."""

    format: Format
    port: str
    baud: int
    channels: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> PortSpec:
        """Raises UsageError for anything else, or an unknown format."""
        match = _SPEC.fullmatch(text)
        if match is None:
            serial_format(text)  # names the formats if it is not even one of them
            raise UsageError(
                f"The gauge {text!r} lacks its port.", f"Write it as {text}:/dev/ttyUSB0."
            )
        chosen = serial_format(match["format"])
        channels = tuple(match["channels"].split(",")) if match["channels"] else ()
        return cls(chosen, match["port"], int(match["baud"] or chosen.baud), channels)


class SerialGauge:
    """One serial line; with channels given, one of them per gauge set side by side."""

    def __init__(self, spec: PortSpec) -> None:
        self._spec = spec
        self._splitter = Splitter()
        self._line: serial.Serial | None = None
        self._stand = 0
        self.hint = (
            "press Return or the gauge's button" if spec.format.request else "press its button"
        )

    @property
    def name(self) -> str:
        """As in the records."""
        return f"{self._spec.format.name}:{self._spec.port}"

    @property
    def is_open(self) -> bool:
        """False after the gauge was lost."""
        return self._line is not None

    def open(self) -> None:
        """Open the port.

        Raises:
            UsageError: pyserial is not installed.
            GaugeLost: the port is not there, or in use.
        """
        try:
            import serial
        except ImportError as error:
            raise UsageError(
                "Serial gauges need pyserial.", "Install it: pip install 'orthocal[serial]'"
            ) from error
        spec = self._spec
        try:
            self._line = serial.Serial(
                spec.port,
                baudrate=spec.baud,
                bytesize=spec.format.data_bits,
                parity=spec.format.parity,
                stopbits=spec.format.stop_bits,
                timeout=0,
                write_timeout=1.0,
                exclusive=True,
            )
        except (OSError, ValueError) as error:
            raise GaugeLost(
                f"The gauge on {spec.port} cannot be reached: {_reason(error)}.",
                "Check its cable, or end with q and resume with another --gauge.",
            ) from error
        self._splitter = Splitter()

    def begin(self, step: Step, takes: int) -> None:
        """Only what is sent while its prompt is shown counts."""
        self._stand = step.stand
        if self._line is not None:
            with suppress(OSError, TypeError):  # the next poll reports it
                waiting = self._line.read(self._line.in_waiting)
                self._splitter.discard(waiting, time.monotonic())

    def request(self) -> None:
        """Send the format's request, if it has one."""
        if self._spec.format.request and self._line is not None:
            try:
                self._line.write(self._spec.format.request)
            except OSError as error:
                raise self._lost(error) from error

    def poll(self) -> list[Heard]:
        """Tokens that arrived completely. Raises GaugeLost."""
        if self._line is None:
            raise self._lost(OSError("it is not open"))
        try:
            data = self._line.read(self._line.in_waiting or 1)
        except (OSError, TypeError) as error:  # pyserial: TypeError once the port has gone
            raise self._lost(error) from error
        now = time.monotonic()
        heard = [self._heard(raw) for raw in self._splitter.feed(data, now)]
        cut = self._splitter.stale(now)
        if cut:
            heard.append(Heard(Token(None, "", "", cut), self.name))
        return heard

    def reconnect(self) -> bool:
        """Try to open the port again."""
        try:
            self.open()
        except GaugeLost:
            return False
        return True

    def close(self) -> None:
        """Close the port."""
        if self._line is not None:
            with suppress(OSError):
                self._line.close()
            self._line = None

    def _lost(self, error: Exception) -> GaugeLost:
        self.close()
        return GaugeLost(f"The gauge on {self._spec.port} does not answer: {_reason(error)}.")

    def _heard(self, raw: str) -> Heard:
        token = self._spec.format.parse(raw)
        channels = self._spec.channels
        if not channels or not token.channel:
            return Heard(token, self.name)
        wanted = channels[min(self._stand, len(channels) - 1)]
        name = f"{self.name}#{token.channel}"
        if token.channel.lstrip("0") == wanted.lstrip("0"):
            return Heard(token, name)
        return Heard(token, name, f"That was channel {token.channel}; channel {wanted} is asked.")


class GaugePair:
    """One line for each of the gauges that are read side by side."""

    def __init__(self, gauges: list[SerialGauge]) -> None:
        self._gauges = gauges
        self._stand = 0
        self.hint = gauges[0].hint

    def open(self) -> None:
        """Open all ports. Raises as `SerialGauge.open` does."""
        for gauge in self._gauges:
            gauge.open()

    def begin(self, step: Step, takes: int) -> None:
        """A prompt for the gauge of this step appears."""
        self._stand = min(step.stand, len(self._gauges) - 1)
        self.hint = self._gauges[self._stand].hint
        for gauge in self._gauges:
            gauge.begin(step, takes)

    def request(self) -> None:
        """Ask the gauge that is wanted."""
        self._gauges[self._stand].request()

    def poll(self) -> list[Heard]:
        """What all gauges said; only the one that is asked counts. Raises GaugeLost."""
        heard: list[Heard] = []
        for number, gauge in enumerate(self._gauges):
            for item in gauge.poll():
                other = f"That was gauge {number + 1}; gauge {self._stand + 1} is asked."
                heard.append(
                    item if number == self._stand else Heard(item.token, item.source, other)
                )
        return heard

    def reconnect(self) -> bool:
        """Try to open the ports that are closed."""
        for gauge in self._gauges:
            if not gauge.is_open:
                gauge.reconnect()
        return all(gauge.is_open for gauge in self._gauges)

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
