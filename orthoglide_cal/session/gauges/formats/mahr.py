"""Mahr MarCator, MarConnect RS232: `  12.345 mm`."""

from orthoglide_cal.session.gauges.token import Format

FORMAT = Format(
    name="mahr",
    about="Mahr MarCator (12.345 mm)",
    pattern=r"\s*(?P<value>[+-]?\s*\d{1,4}\.\d{1,6})\s+(?P<unit>mm|inch|in)\s*",
)
