"""Differences between operating systems: terminal, lock, giving a file its name.

Each system is a module with the same names; which one is there is chosen once.

    Terminal(descriptor)      the keys of a terminal as they are pressed, and nothing shown of them:
                              read, write, disturbed, close
    lock(descriptor)          lock a file until it is closed or the process ends, however; raises
                              OSError if it is locked
    publish(temporary, path)  give a finished file its name; raises FileExistsError if another file
                              has it
    keep_owner(path, other)   give another file its owner and group; raises OSError if nobody may
    sync_folder(folder)       make new names in a folder survive a power loss, as far as the system
                              can
"""

import sys

if sys.platform == "win32":
    from orthoglide_cal.system import windows as SYSTEM
else:
    from orthoglide_cal.system import posix as SYSTEM
