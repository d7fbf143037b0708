"""What texts of files may be: numbers by a strict pattern, counts, versions, dates."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orthoglide_cal.errors import InputError
from orthoglide_cal.files.text import number_text
from orthoglide_cal.schema import parse_count, parse_number, yaml_number


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.12", 0.12), ("-0.12", -0.12), ("+0000.123", 0.123), ("\u22121.5", -1.5),
        (".5", 0.5), ("5.", 5.0), ("1e-3", 1e-3), ("1E+2", 100.0), (" 7 ", 7.0), ("-0", 0.0),
    ],
)  # fmt: skip
def test_numbers(text, value):
    assert parse_number(text) == value


@pytest.mark.parametrize(
    "text",
    ["", "nan", "inf", "-Infinity", "1_000", "0x1F", "1:30", "on", "true", "1 000", "1.2.3", "--1",
     "1e", "e5", "٣", "½", "1.234,5", "12mm", "1" * 41, "1" * 99, "ERR6", "01A+0000.123"],
)  # fmt: skip
def test_not_numbers(text):
    with pytest.raises(InputError, match="not a number") as caught:
        parse_number(text, decimal_comma=True)
    assert caught.value.remedy
    assert len(caught.value.value) <= 60


def test_decimal_comma_only_where_allowed():
    assert parse_number("-0,125", decimal_comma=True) == -0.125
    with pytest.raises(InputError, match="decimal comma") as caught:
        parse_number("-0,125")
    assert "semicolons" in caught.value.remedy


def test_too_large():
    with pytest.raises(InputError, match="too large"):
        parse_number("1e999")


@pytest.mark.parametrize("text", ["012", "-007", "00"])
def test_yaml_octal_is_ambiguous(text):
    with pytest.raises(InputError, match="octal"):
        yaml_number(text)
    assert yaml_number("0.12") == 0.12
    assert yaml_number("0") == 0.0


def test_counts():
    assert parse_count(" 3 ", 1) == 3
    for text in ("0", "-1", "1.0", "1e2", "x", "", "9" * 30):
        with pytest.raises(InputError, match="whole number"):
            parse_count(text, 1)


@given(st.floats(allow_nan=False, allow_infinity=False))
@settings(max_examples=200, derandomize=True, deadline=None)
def test_every_number_reads_back_exactly(value):
    assert yaml_number(number_text(value)) == parse_number(number_text(value)) == value
    assert number_text(60.0) == "60"
