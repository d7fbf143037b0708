"""Mitutoyo U-WAVE radio receiver: `DT1`, group and channel digits, value, `M` or `I`."""

from orthoglide_cal.session.gauges.token import Format

FORMAT = Format(
    name="uwave",
    about="Mitutoyo U-WAVE receiver (DT10001+0000.123M)",
    pattern=r"DT1(?P<channel>\d{0,6})(?P<value>[+-]\d{1,6}\.\d{1,6})(?P<unit>[MI])",
    baud=57600,
)
