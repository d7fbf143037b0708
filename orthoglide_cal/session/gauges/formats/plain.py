"""Any gauge that sends just the number, with or without its unit: `-1.23`, `0,456 mm`."""

from orthoglide_cal.session.gauges.token import Format

FORMAT = Format(
    name="plain",
    about="any gauge that sends only a number with a decimal mark (-1.23 mm)",
    pattern=r"\s*(?P<value>[+-]?\s?\d{0,4}[.,]\d{1,6})\s*(?P<unit>mm|inch|in|\")?\s*",
)
