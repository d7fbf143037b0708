"""What gauges say and people type: readings, and above all what never becomes one."""

import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from orthoglide_cal.errors import InputError, UsageError
from orthoglide_cal.session.gauges import (
    PATIENCE_S,
    SERIAL_FORMATS,
    SerialGauge,
    SerialPort,
    SimulatedGauge,
    Token,
    parse_typed,
)
from orthoglide_cal.words import Unit
from tests.cli.program import done

from .virtual import setting_of, steps_of

MM, INCH = Unit.MM, Unit.INCH

GIVEN = yaml.safe_load(Path(__file__).with_name("gauges.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("name", "line", "value", "unit", "channel"), GIVEN["formats"])
def test_lines_in_use(
    name: str, line: str, value: float, unit: Unit | None, channel: str | None
) -> None:
    assert SERIAL_FORMATS[name].parse(line) == Token(line, value, unit, channel)


@pytest.mark.parametrize("name", sorted(SERIAL_FORMATS))
@pytest.mark.parametrize("line", GIVEN["no_values"])
def test_errors_never_become_values(name: str, line: str) -> None:
    assert SERIAL_FORMATS[name].parse(line).value is None


def test_a_format_knows_its_line() -> None:
    sylvac = SERIAL_FORMATS["sylvac"]
    line = (sylvac.baud, sylvac.data_bits, sylvac.parity, sylvac.stop_bits, sylvac.request)
    assert line == (4800, 7, "E", 2, b"?\r")


def test_inches_become_millimetres_once() -> None:
    assert Token("", 0.005, INCH).mm(MM) == 0.127
    assert Token("", 0.005).mm(INCH) == 0.127
    assert Token("", 0.005, MM).mm(INCH) == 0.005
    assert Token("", 0.005).mm(MM) == 0.005
    with pytest.raises(ValueError, match="error message"):
        Token("ERR6").mm(MM)
    assert Token("", 0.0003).mm(INCH) == 0.00762  # without the dust of the multiplication


@pytest.mark.parametrize(
    ("text", "port", "baud", "channels"),
    [
        ("sylvac:/dev/ttyUSB0", "/dev/ttyUSB0", 4800, ()),
        ("mitutoyo:COM3", "COM3", 9600, ()),
        ("mux:/dev/ttyS0@19200#1,2", "/dev/ttyS0", 19200, ("1", "2")),
    ],
)
def test_ports(text: str, port: str, baud: int, channels: tuple[str, ...]) -> None:
    gauge = SerialPort(text)
    assert (gauge.port, gauge.baud, tuple(gauge.channels)) == (port, baud, channels)


@pytest.mark.parametrize(
    "text",
    ["silvac", "sylvac", "sylvac:", "nothing:/dev/ttyUSB0", "", ":", "a:b@c", "mahr:/dev/x@96k"],
)
def test_bad_ports_are_usage_errors(text: str) -> None:
    with pytest.raises(UsageError) as caught:
        SerialPort(text)
    speed = "@96k" in text
    assert ("'96k' is not a number of baud" if speed else "sylvac") in str(caught.value)


@pytest.mark.parametrize("end", [b"\r", b"\n", b"\r\n", b"\t"])
@pytest.mark.parametrize("size", [1, 2, 3, 7, 100])
def test_tokens_are_cut_at_any_line_end_in_pieces_of_any_size(end: bytes, size: int) -> None:
    data = end.join([b"01A+0000.123", b"01A-0001.500", b""])
    port, found = SerialPort("mitutoyo:/dev/x"), []
    for at in range(0, len(data), size):
        found += port.tokens(data[at : at + size], now=0.0)
    assert [token.value for token in found] == [0.123, -1.5]


def test_a_token_without_its_end_is_thrown_away_after_a_while() -> None:
    port = SerialPort("mitutoyo:/dev/x")
    assert port.tokens(b"01A+0000.1", now=10.0) == []
    assert port.tokens(b"", now=10.0 + 0.9 * PATIENCE_S) == []
    assert port.tokens(b"", now=10.0 + 1.1 * PATIENCE_S) == [Token("01A+0000.1")]
    assert port.tokens(b"23\r", now=12.0) == [Token("23")]


def test_noise_without_end_does_not_fill_the_memory() -> None:
    port = SerialPort("mahr:/dev/x")
    for _ in range(1000):
        assert port.tokens(b"\xff" * 100, now=0.0) == []
    assert [token.value for token in port.tokens(b"\r1.000 mm\r", now=0.0)] == [1.0]
    port.tokens(b"\xff" * 1000, now=0.0)
    (token,) = port.tokens(b"", now=10.0)
    assert (token.value, len(token.raw)) == (None, 120)


@pytest.mark.parametrize(("text", "value", "unit"), GIVEN["typed"])
def test_typed_numbers(text: str, value: float, unit: Unit | None) -> None:
    token = parse_typed(text)
    assert (token.value, token.unit) == (value, unit)


@pytest.mark.parametrize("text", [*GIVEN["not_typed"], "1" * 200])
def test_typed_text_that_is_no_reading(text: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_typed(text)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 120


def test_the_simulated_gauge_reads_the_same_after_a_restart() -> None:
    steps = steps_of()

    def read(gauge: SimulatedGauge, index: int, takes: int) -> float | None:
        gauge.begin(steps[index], takes)
        assert gauge.poll(asked=False) == []  # it waits to be asked
        return gauge.poll(asked=True)[0].value

    one, other = (SimulatedGauge(setting_of(steps), 7) for _ in range(2))
    forth = [read(one, index, 0) for index in range(60)]
    back = [read(other, index, 0) for index in reversed(range(60))][::-1]
    assert forth == back
    assert [read(one, index, 1) for index in range(60)] != forth
    assert not np.array_equal(SimulatedGauge(setting_of(steps), 8).offsets_mm, one.offsets_mm)


def test_the_help_names_every_format() -> None:
    """The command's text is fixed, so that --help need not load the formats."""
    help_text = done("measure", "--help")
    for name in SERIAL_FORMATS:
        assert f" {name}" in help_text


def test_without_pyserial_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(UsageError, match=r"pip install 'orthocal\[serial\]'"):
        SerialPort("plain:/dev/ttyUSB0").open()


def test_of_two_gauges_the_one_that_is_wanted_is_asked_and_counts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[str, bool]] = []

    def read(port: SerialPort, wanted: bool) -> list[Token]:
        asked.append((port.port[-1], wanted))
        return [Token("+1.0", 1.0)]

    monkeypatch.setattr(SerialPort, "read", read)
    pair, steps = SerialGauge([f"sylvac:/dev/ttyUSB{number}" for number in (0, 1)]), steps_of()
    for index, other in ((0, "1"), (1, "0")):
        asked.clear()
        pair.begin(steps[index], 0)
        heard = pair.poll(asked=True)
        assert asked == [("0", index == 0), ("1", index == 1)]
        assert [item.source[-1] for item in heard if item.elsewhere] == [other]
