"""How an operator leaves a session before its end."""


class Quit(Exception):
    """Saved; to be resumed later."""
