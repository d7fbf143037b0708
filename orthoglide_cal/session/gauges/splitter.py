"""Cuts the bytes of a serial line into tokens at CR, LF or TAB."""

from __future__ import annotations

_ENDS = b"\r\n\t"
# Longer than any token in use: what exceeds it is noise on the line.
_LONGEST = 120
# A token whose end does not follow within this time was cut off on its way.
PATIENCE_S = 1.0


class Splitter:
    """Collects bytes; a token counts only when its end has arrived."""

    def __init__(self) -> None:
        self._rest = b""
        self._since = 0.0

    def feed(self, data: bytes, now: float) -> list[str]:
        """Tokens completed by `data`, blank ones left out.

        Args:
            data: what arrived, in pieces of any size.
            now: monotonic time [s].
        """
        if data and not self._rest:
            self._since = now
        tokens: list[str] = []
        for byte in data:
            if byte in _ENDS:
                tokens.append(self._take())
            else:
                self._rest += bytes((byte,))
                if len(self._rest) > _LONGEST:
                    self._rest = b""
        return [token for token in tokens if token.strip()]

    def stale(self, now: float) -> str:
        """An unfinished token that is too old to be completed; it is thrown away."""
        if self._rest and now - self._since > PATIENCE_S:
            return self._take()
        return ""

    def clear(self) -> None:
        """Forget what arrived so far."""
        self._rest = b""

    def _take(self) -> str:
        rest, self._rest = self._rest, b""
        return rest.decode("ascii", errors="replace").strip("\0")
