"""The guided measurement: steps, live checks, journal, gauges; no numerics of its own."""

from orthoglide_cal.session.desk import Desk, Keyboard, Show, Typed
from orthoglide_cal.session.files import publish
from orthoglide_cal.session.intake import Setting
from orthoglide_cal.session.opening import Wanted, protocol_name
from orthoglide_cal.session.quit import Quit
from orthoglide_cal.session.record import readings, session_record
from orthoglide_cal.session.run import Run
from orthoglide_cal.session.sitting import Request, Sitting, clock, open_sitting
from orthoglide_cal.session.state import State, replay
from orthoglide_cal.session.steps import ORDERS, PROTOCOLS, sequence

__all__ = [
    "ORDERS",
    "PROTOCOLS",
    "Desk",
    "Keyboard",
    "Quit",
    "Request",
    "Run",
    "Setting",
    "Show",
    "Sitting",
    "State",
    "Typed",
    "Wanted",
    "clock",
    "open_sitting",
    "protocol_name",
    "publish",
    "readings",
    "replay",
    "sequence",
    "session_record",
]
