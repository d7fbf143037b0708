"""Differences between operating systems: terminal and lock.

Each system is a module with the same names, as `posix` explains them.
"""

import sys

if sys.platform == "win32":
    from orthoglide_cal.system import windows as SYSTEM
else:
    from orthoglide_cal.system import posix as SYSTEM
