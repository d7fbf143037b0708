"""Chicago Dial Indicator and Starrett: `+ 2.1380, MM`, with blanks between the digits."""

from orthoglide_cal.session.gauges.token import Format

FORMAT = Format(
    name="cdi",
    about="CDI Logic, Starrett (+ 2.1380, MM)",
    pattern=r"(?P<value>[+-][ 0-9]{1,9}\.[ 0-9]{1,8}?)\s*,\s*(?P<unit>MM|IN)\s*",
    request=b"R\r",
)
