"""Gauges: serial, typed and simulated; and the joints of a running LinuxCNC that is followed."""

import math
import re
import socket
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from orthoglide_cal.errors import InputError, OrthocalError, UsageError, system_words, visible
from orthoglide_cal.files.moonraker import in_time
from orthoglide_cal.model.model import simulate
from orthoglide_cal.model.plan import Floats
from orthoglide_cal.model.readings import AXES
from orthoglide_cal.planning.steps import SessionStep
from orthoglide_cal.session.readings import Setting
from orthoglide_cal.words import MM_PER_INCH, Unit

if TYPE_CHECKING:
    import serial

# Error messages that look like numbers: they must never become one.
_ERROR_CODES = re.compile(r"[+-]?9{5,}(?:\.9+)?|9[0-9]{2}")
_UNITS = {"m": Unit.MM, "mm": Unit.MM} | dict.fromkeys(("i", "in", "inch", '"'), Unit.INCH)


class GaugeLost(OrthocalError):
    """The gauge does not answer any more: unplugged, switched off, or the port is in use."""

    exit_code = 3


def by_axis(values: Iterable[float], form: str, gap: str = "  ") -> str:
    """ "X 1.5  Y 0  Z -2": one number for each axis, never parted from it."""
    parts = (f"{axis.upper()} {value:{form}}" for axis, value in zip(AXES, values, strict=True))
    return gap.join(parts)


class Token(NamedTuple):
    """One message of a gauge or one typed number, understood."""

    raw: str  # the characters that arrived
    value: float | None = None  # as shown by the gauge, in `unit`; None for an error message
    unit: Unit | None = None  # None where the gauge does not say
    channel: str | None = None  # of a multiplexer
    source: str = "typed"  # the gauge's name for the records
    elsewhere: str | None = None  # a sentence if not this gauge was asked: its value is not used

    def mm(self, default: Unit) -> float:
        """The value in mm; `default` is its unit where the gauge gave none."""
        if self.value is None:
            raise ValueError("an error message is not a reading")
        if (self.unit or default) is Unit.MM:
            return self.value
        # A gauge never shows more than a nanometre: drop the dust of the multiplication.
        return round(self.value * MM_PER_INCH, 6)


class LiveGauge(Protocol):
    """A gauge that the program listens to, in addition to the keyboard."""

    hint: str  # what to do for a reading, e.g. "press its button"
    silence: str = ""  # what to check where Return was pressed and nothing came
    # Nobody need be there: the end of a pipe presses Return for ever, and no press comes too soon.
    reads_itself: bool = False

    def begin(self, step: SessionStep, takes: int) -> None:
        """A prompt for this step, which was read `takes` times: forget what was said before."""

    def poll(self, asked: bool) -> list[Token]:
        """Return messages since the last call; `asked`: Return was pressed. Raises GaugeLost."""


# ---- gauges on serial lines

_ENDS = re.compile(rb"[\r\n\t]")
_LONGEST = 120  # longer than any token in use: what exceeds it is noise on the line
PATIENCE_S = 1.0  # a token whose end does not follow within this time was cut off on its way [s]


@dataclass(frozen=True)
class SerialFormat:
    """Serial line and messages of one family of gauges."""

    pattern: str  # of a whole token; groups `value` and optionally `unit`, `channel`
    baud: int = 9600
    data_bits: int = 8
    parity: str = "N"
    stop_bits: int = 1
    request: bytes | None = None  # asks for a reading; None if only its button sends one

    def parse(self, raw: str) -> Token:
        """Read a token; its value is None unless every character is as expected."""
        if not (match := re.fullmatch(self.pattern, raw, flags=re.ASCII | re.IGNORECASE)):
            return Token(raw)
        given = match.groupdict("")
        digits = given["value"].replace(" ", "").replace(",", ".")
        channel = given.get("channel") or None
        if _ERROR_CODES.fullmatch(digits):
            return Token(raw, channel=channel)
        unit = _UNITS.get(given.get("unit", "").lower())
        return Token(raw, float(digits) + 0.0, unit, channel)  # a reading of -0 is 0


# A new gauge is one more entry here, and its name in the help of `orthocal measure --gauge`.
SERIAL_FORMATS = {  # by the name in --gauge NAME:PORT
    # Chicago Dial Indicator, Starrett: "+ 2.1380, MM", with blanks between the digits.
    "cdi": SerialFormat(
        r"(?P<value>[+-][ 0-9]{1,9}\.[ 0-9]{1,8}?)\s*,\s*(?P<unit>MM|IN)\s*", request=b"R\r"
    ),
    # Mahr MarCator, MarConnect RS232: "  12.345 mm".
    "mahr": SerialFormat(r"\s*(?P<value>[+-]?\s*\d{1,4}\.\d{1,6})\s+(?P<unit>mm|inch|in)\s*"),
    # Mitutoyo MUX-10, QM-Height, USB input tools: "01A+0000.123", the gauge sets the unit.
    "mitutoyo": SerialFormat(r"(?P<channel>\d\d?)A(?P<value>[+-]\d{1,6}\.\d{1,6})"),
    # Multiplexers MUX 2, MUX 4: "1 MW+003.4665 inch"; "3 TO 999999.99 mm" is an error.
    "mux": SerialFormat(
        r"(?P<channel>\d) MW\s?(?P<value>[+-]\d{1,6}\.\d{1,6}) (?P<unit>mm|inch)\s*"
    ),
    # Gauges that send only a number with a decimal mark: "-1.23", "0,456 mm".
    "plain": SerialFormat(
        r"\s*(?P<value>[+-]?\s?\d{0,4}[.,]\d{1,6})\s*(?P<unit>mm|inch|in|\")?\s*"
    ),
    # Sylvac, Tesa, Diatest over an opto cable: "+12.345" after "?".
    "sylvac": SerialFormat(
        r"(?P<value>[+-]\d{1,4}\.\d{1,6})",
        baud=4800, data_bits=7, parity="E", stop_bits=2, request=b"?\r",
    ),
    # Mitutoyo U-WAVE radio receiver: "DT10001+0000.123M", group and channel, M or I.
    "uwave": SerialFormat(
        r"DT1(?P<channel>\d{0,6})(?P<value>[+-]\d{1,6}\.\d{1,6})(?P<unit>[MI])", baud=57600
    ),
}  # fmt: skip
_PORT = re.compile(rf"({'|'.join(SERIAL_FORMATS)}):([^#@]+)(?:@([^#]*))?(?:#([\w,]+))?")
_TYPED = SerialFormat(
    r"(?P<value>[+-]?\s?(?:\d{1,6}(?:[.,]\d{0,6})?|[.,]\d{1,6}))\s*(?P<unit>mm|inch|in|\")?"
)


def parse_typed(text: str) -> Token:
    """Read what a person or a keyboard-wedge gauge types at a prompt.

    Accepts a sign (also U+2212), decimal point or comma, and a unit; nothing else. Exponents,
    digit groups and error codes are not readings. Raises InputError.
    """
    plain = text.strip().replace("\u2212", "-")
    if (token := _TYPED.parse(plain)).value is not None:
        return token._replace(raw=text.strip())
    clean = visible(plain)
    fault = "not a reading. Type a number such as -0.12, or ? for help."
    if _ERROR_CODES.fullmatch(plain) or re.search(r"(?i)err|^\d\s+to\b", plain):
        fault = "an error message of the gauge, not a reading."
    raise InputError(f"'{clean if len(clean) <= 24 else clean[:23] + '~'}' is {fault}")


class SerialPort:
    """The serial line `FORMAT:PORT[@BAUD][#CHANNEL[,CHANNEL]]`. Raises UsageError for others."""

    def __init__(self, text: str) -> None:
        if not (match := _PORT.fullmatch(text)):
            remedy = "Choose typed, simulated, or FORMAT:PORT, such as sylvac:/dev/ttyUSB0, with"
            remedy += f" one of {', '.join(SERIAL_FORMATS)}."
            raise UsageError(f"There is no gauge {text!r}.", remedy)
        name, self.port, speed, channels = match.groups()
        self.format, self.name = SERIAL_FORMATS[name], f"{name}:{self.port}"
        if not (speed is None or speed.isdecimal()):
            remedy = f"{name} usually has @{self.format.baud}, which may be left out."
            raise UsageError(f"The speed {speed!r} is not a number of baud.", remedy)
        self.baud = int(speed or self.format.baud)
        # Of the gauges that are read side by side; none if the line is of one gauge.
        self.channels: list[str] = channels.split(",") if channels else []
        self._line: serial.Serial | None = None
        self._rest, self._since = b"", 0.0  # of a message that has not ended, and when it began
        self._decimals: dict[object, int] = {}  # the most so far, of a channel in a unit

    def open(self) -> "serial.Serial":
        """The open port. Raises UsageError without pyserial, GaugeLost."""
        if self._line is not None:
            return self._line
        try:
            import serial
        except ImportError as error:
            remedy = "Install it: pip install 'orthocal[serial]'"
            raise UsageError("Serial gauges need pyserial.", remedy) from error
        try:
            self._line = serial.Serial(
                self.port, baudrate=self.baud, bytesize=self.format.data_bits,
                parity=self.format.parity, stopbits=self.format.stop_bits,
                timeout=0, write_timeout=1.0, exclusive=True,
            )  # fmt: skip
        except (OSError, ValueError) as error:
            fault = f"The gauge on {self.port} cannot be reached: {_reason(error)}."
            remedy = "Check its cable, and the name of the port after --gauge."
            raise GaugeLost(fault, remedy) from error
        self._rest = b""
        return self._line

    def read(self, asked: bool) -> list[Token]:
        """Messages that have arrived, cut by `tokens`. Raises GaugeLost.

        A port that was lost is opened; if `asked`, the format's request is sent, if it has one.
        """
        line = self.open()
        try:
            if asked and self.format.request:
                line.write(self.format.request)
            data = line.read(line.in_waiting or 1)
        except (OSError, TypeError) as error:  # pyserial: TypeError once the port has gone
            self.close()
            fault = f"The gauge on {self.port} does not answer: {_reason(error)}."
            raise GaugeLost(fault) from error
        return self.tokens(data, time.monotonic())

    def tokens(self, data: bytes, now: float) -> list[Token]:
        """Messages that what arrives completes, blank ones left out; `now` is monotonic time [s].

        They are cut at CR, LF or TAB. One whose end never came is no reading, nor is a number with
        fewer decimals than the gauge had before.
        """
        *whole, rest = _ENDS.split(self._rest + data)
        if data and (whole or not self._rest):
            self._since = now
        self._rest = rest[: _LONGEST + 1]
        texts = map(_decoded, (message for message in whole if len(message) <= _LONGEST))
        tokens = [self._complete(self.format.parse(text)) for text in texts if text.strip()]
        if now - self._since > PATIENCE_S:
            cut, self._rest = _decoded(self._rest[:_LONGEST]), b""
            tokens += [Token(cut)] if cut else []
        return tokens

    def _complete(self, token: Token) -> Token:
        decimals = re.search(r"[.,](\d+)", token.raw)
        if token.value is None or decimals is None:
            return token
        gauge, count = (token.channel, token.unit), len(decimals[1])
        most = self._decimals[gauge] = max(count, self._decimals.get(gauge, 0))
        short = f"It had {most} decimals before: press again; or q and --resume if you changed"
        return token._replace(elsewhere=f"{short} that." if count < most else None)

    def close(self) -> None:
        """Let go of the port."""
        if self._line is not None:
            with suppress(OSError):
                self._line.close()
            self._line = None


class SerialGauge(LiveGauge):
    """Gauges side by side, on ports (as of `SerialPort`) or channels of their own."""

    def __init__(self, source: Sequence[str]) -> None:
        self.ports = [SerialPort(text) for text in source]
        asks = any(port.format.request for port in self.ports)
        self.hint = f"press {'Return or ' if asks else ''}the gauge's button"
        self._stand = self._wanted = 0  # gauge and port that are listened to

    def begin(self, step: SessionStep, takes: int) -> None:
        """Listen to the gauge of this step."""
        self._stand, self._wanted = step.stand, min(step.stand, len(self.ports) - 1)
        port = self.ports[self._wanted]
        answer = f"Return cannot ask the gauge on {port.port}: press its button. Nothing?"
        if port.format.request:
            answer = f"The gauge on {port.port} did not answer. Press its button."
        self.silence = f"{answer} Is it on, its cable plugged in, and set to {port.baud} baud?"

    def poll(self, asked: bool) -> list[Token]:
        """Return what all gauges said; only the one that is wanted is asked, and counts."""
        heard: list[Token] = []
        for number, port in enumerate(self.ports):
            for token in port.read(asked and number == self._wanted):
                name, elsewhere = port.name, token.elsewhere
                if port.channels and token.channel is not None:
                    channel = port.channels[min(self._stand, len(port.channels) - 1)]
                    name += f"#{token.channel}"
                    if token.channel.lstrip("0") != channel.lstrip("0"):
                        elsewhere = f"That was channel {token.channel}; channel {channel} is next."
                if number != self._wanted:
                    elsewhere = f"That was gauge {number + 1}; gauge {self._wanted + 1} is next."
                heard.append(token._replace(source=name, elsewhere=elsewhere))
        return heard


def _decoded(message: bytes) -> str:
    return message.decode("ascii", "replace").strip("\0")


def _reason(error: Exception) -> str:
    """The reason in an error of pyserial."""
    match = re.search(r".*\] (.+?)(?:: '|$)", str(error))
    return match.group(1) if match else str(error).rstrip(".")


# ---- a running LinuxCNC: `linuxcncrsh` answers one line for each line over TCP (its manual page).
# Nothing here can move a machine.

PORT = 5007
NEAR_MM = 0.05  # farther from the posture, a reading is questioned
_TIMEOUT_S = 2.0
_ADDRESS = re.compile(r"linuxcnc(?::([^:\[\]\s]+|\[[^\]\s]+\])(?::([0-9]{1,5}))?)?")
_UNITS_MM = {"MM": 1.0, "INCH": MM_PER_INCH, "CM": 10.0}


class Standing:
    """The joints of a controller at `linuxcnc[:HOST[:PORT]]`. Raises UsageError: none to follow."""

    def __init__(self, address: str) -> None:
        parts = _ADDRESS.fullmatch(address)
        if parts is None or not 0 < (port := int(parts[2] or PORT)) < 65536:
            raise UsageError(f"{address!r} cannot be followed.", "Write linuxcnc[:HOST[:PORT]].")
        host = (parts[1] or "localhost").strip("[]")
        try:
            with socket.create_connection((host, port), _TIMEOUT_S) as connection:
                self._line = connection.makefile("rwb", buffering=0)  # open until this closes
            self.close = self._line.close
            self._ask("hello EMC orthocal 1.0", "HELLO ACK")
            (unit,) = self._ask("get user_linear_units", "USER_LINEAR_UNITS")
            self._unit_mm = _UNITS_MM[unit]
            # Identity: its joints are the axes of the tool, in the order of its `coordinates`.
            self._identity = self._ask("get kinematics_type", "KINEMATICS_TYPE") == ["1"]
        except (OSError, KeyError, ValueError) as error:
            fault = f"No LinuxCNC can be followed at {host}:{port}: {system_words(error)}."
            remedy = "Start linuxcncrsh on that computer, with its usual password (man linuxcncrsh)"
            raise UsageError(fault, f"{remedy}; or measure without --follow.") from error
        if not self._homed():
            self.close()
            problem = f"The LinuxCNC at {host}:{port} is not homed: nobody knows where it stands."
            raise UsageError(problem, "Home all joints, then give the command again.")

    def at(self, joints: Floats, tool: Floats, home_mm: float) -> tuple[float, str]:
        """Largest distance of a joint from these joints and this tool (3,) [mm], and its place.

        A controller without kinematics is driven to either, and may count from the joint value of
        the isotropic posture. Raises OSError, ValueError: nothing answers any more, or no place.
        """
        if not self._homed():
            raise ConnectionError("it is not homed any more")
        name = "abs_act_pos" if self._identity else "joint_pos"
        stands = self._unit_mm * np.array(self._ask(f"get {name}", name.upper())[:3], dtype=float)
        wanted = np.stack([joints, joints - home_mm, *([tool] if self._identity else [])])
        away = float(np.abs(wanted - stands).max(axis=1).min())
        return away, f"the controller stood at {by_axis(stands, '.3f', ' ')}"

    def _homed(self) -> bool:
        """True if all joints are homed: before, their positions are arbitrary. Raises OSError."""
        return self._ask("get joint_homed", "JOINT_HOMED")[:3] == ["YES"] * 3

    def _ask(self, question: str, answer: str) -> list[str]:
        """The words of an answer behind its name. Raises OSError."""
        self._line.write(question.encode() + b"\n")
        for _ in range(2):  # what was sent is echoed first
            read = in_time(lambda: self._line.readline(400), _TIMEOUT_S)
            line = read.decode("ascii", "replace").strip().upper()
            if line.startswith(answer):
                return line.removeprefix(answer).split()
            if not line.startswith(question.upper()):
                raise ConnectionError(f"the answer is {line!r}" if line else "it has closed")
        raise ConnectionError("no answer")


# ---- a virtual machine whose joint offsets are hidden: for training and for trying

OFFSETS_MM, ZEROS_MM = 1.5, 0.3  # half the ranges that the hidden truth is drawn from
_FINEST_MM = 1e-6  # in which two active offsets are distinguished
_TRUTH, _NOISE = 0, 1  # streams of random numbers


class SimulatedGauge(LiveGauge):
    """Reads what the real gauges would; the same seed gives the same readings.

    The hidden offsets are those of the machine without any correction: what is active acts. Each
    reading has its stream of random numbers (seed, step, take, active offsets): an interrupted
    session reads the same as any other. In one that continues others, steps count from theirs on,
    and every part has its own zeros.
    """

    hint = "press Return"
    reads_itself = True

    def __init__(self, setting: Setting, seed: int) -> None:
        self._gauge, self._seed = setting.machine.instrument, seed
        active = np.array(setting.machine.active)
        steps = (active / _FINEST_MM).round().astype(np.int64) % 2**32
        self._active: list[int] = steps.tolist() if steps.any() else []
        rng = np.random.default_rng([seed, _TRUTH])
        self.offsets_mm: Floats = rng.uniform(-OFFSETS_MM, OFFSETS_MM, 3) - active
        plan = setting.plan
        later = (np.random.default_rng([seed, _TRUTH, part]) for part in range(1, plan.parts))
        zeros = np.array([part.uniform(-ZEROS_MM, ZEROS_MM, (3, 3)) for part in (rng, *later)])
        self._exact = simulate(setting.model, self.offsets_mm, plan)
        self._exact += zeros[plan.part, plan.leg, plan.direction]
        self._before = len(setting.first.readings) if setting.first else 0
        self._wanted = (1, 0)  # step and take

    def begin(self, step: SessionStep, takes: int) -> None:
        self._wanted = (step.number, takes)

    def poll(self, asked: bool) -> list[Token]:
        """The reading, once Return was pressed."""
        if not asked:
            return []
        step, takes = self._wanted
        division = self._gauge.resolution_mm
        rng = np.random.default_rng([self._seed, _NOISE, self._before + step, takes, *self._active])
        noisy = self._exact[step - 1] + rng.normal(0.0, self._gauge.repeatability_mm)
        value = round(round(noisy / division) * division, 6)
        decimals = max(0, math.ceil(-math.log10(division)))
        return [Token(f"{value:+.{decimals}f}", value, Unit.MM, source="simulated")]
