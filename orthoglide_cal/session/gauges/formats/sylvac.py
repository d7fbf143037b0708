"""Sylvac (and gauges made by them): `+12.345` after `?`, at 4800 baud, 7E2."""

from orthoglide_cal.session.gauges.token import Format

FORMAT = Format(
    name="sylvac",
    about="Sylvac, Tesa, Diatest over an opto cable (+12.345 after ?)",
    pattern=r"(?P<value>[+-]\d{1,4}\.\d{1,6})",
    baud=4800,
    data_bits=7,
    parity="E",
    stop_bits=2,
    request=b"?\r",
)
