"""Four-channel multiplexers: `1 MW+003.4665 inch`; `3 TO 999999.99 mm` is an error."""

from orthoglide_cal.session.gauges.token import Format

FORMAT = Format(
    name="mux",
    about="MUX 2 and MUX 4 multiplexers (1 MW+003.4665 inch)",
    pattern=r"(?P<channel>\d) MW\s?(?P<value>[+-]\d{1,6}\.\d{1,6}) (?P<unit>mm|inch)\s*",
)
