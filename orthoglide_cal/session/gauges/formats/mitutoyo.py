"""Mitutoyo multiplexers and USB gauges: `01A+0000.123`, the unit is set on the gauge."""

from orthoglide_cal.session.gauges.token import Format

FORMAT = Format(
    name="mitutoyo",
    about="Mitutoyo MUX-10, QM-Height, USB input tools (01A+0000.123)",
    pattern=r"(?P<channel>\d\d?)A(?P<value>[+-]\d{1,6}\.\d{1,6})",
)
