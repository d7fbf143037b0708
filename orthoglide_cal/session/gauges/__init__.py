"""Gauges: typed, keyboard wedge, serial by format, simulated."""

from orthoglide_cal.session.gauges.registry import serial_format, serial_formats
from orthoglide_cal.session.gauges.source import Gauge, GaugeLost, Heard
from orthoglide_cal.session.gauges.token import Format, Token

__all__ = [
    "Format",
    "Gauge",
    "GaugeLost",
    "Heard",
    "Token",
    "serial_format",
    "serial_formats",
]
