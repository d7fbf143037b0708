"""The guided measurement: steps, live checks, journal, gauges; no numerics of its own."""

from orthoglide_cal.session.asking import Show, Style
from orthoglide_cal.session.dialogue import Dialogue, Quit
from orthoglide_cal.session.events import GaugeLabel
from orthoglide_cal.session.opening import Request, open_session, unfinished
from orthoglide_cal.words import Unit
