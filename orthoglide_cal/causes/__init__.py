"""Faults of a machine or a measurement: a file for each stage of a reading.

A new cause is a class in the `CAUSES` of its file, or of a new file here; it is found there.
"""

from orthoglide_cal.causes.motion import HOME_SWITCH
from orthoglide_cal.causes.registry import CAUSES, UNLISTED, correcting
