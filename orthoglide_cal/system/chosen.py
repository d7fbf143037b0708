"""The operating system that the program runs on, chosen once."""

import os
from importlib import import_module

from orthoglide_cal.system.interface import System
from orthoglide_cal.system.windows import Windows


def this_system() -> System:
    """Windows, or else one with POSIX terminals and locks."""
    if os.name == "nt":
        return Windows(import_module("msvcrt"))
    from orthoglide_cal.system.posix import Posix

    return Posix()


SYSTEM: System = this_system()
