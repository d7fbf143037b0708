"""The operating system that the program runs on, by its module, chosen once.

Every system has the same functions; which are there the type checker sees at each call.

    terminal(descriptor)      the terminal that this descriptor reads from
    lock(descriptor)          lock a file until it is closed or the process ends, however; raises
                              OSError if it is locked
    publish(temporary, path)  give a finished file its name; raises FileExistsError if another file
                              has it
    keep_owner(path, other)   give another file its owner and group; raises OSError if nobody may
    sync_folder(folder)       make new names in a folder survive a power loss, as far as the system
                              can
"""

import sys

__all__ = ["SYSTEM"]

if sys.platform == "win32":
    from orthoglide_cal.system import windows as SYSTEM
else:
    from orthoglide_cal.system import posix as SYSTEM
