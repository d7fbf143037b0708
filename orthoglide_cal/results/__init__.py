"""Results for a technician: may the offsets be entered, which, how sure, what is left?"""

from orthoglide_cal.inference import Parameter
from orthoglide_cal.results.answer import RETAKE, Answer, CheckReading, Release, Remedy
from orthoglide_cal.results.application import (
    Application,
    Correction,
    apply,
    recording,
    take_back,
    unwritten,
)
from orthoglide_cal.results.making import answer_to, remainder, with_dates
from orthoglide_cal.results.validity import Identity, Validity, identify
