"""Cuts the bytes of a serial line into tokens at CR, LF or TAB."""

from __future__ import annotations

_ENDS = b"\r\n\t"
# Longer than any token in use: what exceeds it is noise on the line.
_LONGEST = 120
# A token whose end does not follow within this time was cut off on its way [s].
PATIENCE_S = 1.0


class Splitter:
    """Collects bytes; a token counts only if all of it has arrived, to its end."""

    def __init__(self) -> None:
        self._rest = b""
        self._since = 0.0
        self._headless = False

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
                token = self._take()
                if token.strip():
                    tokens.append(token)
            else:
                self._rest += bytes((byte,))
                if len(self._rest) > _LONGEST:
                    self._rest, self._headless = b"", True
        return tokens

    def discard(self, data: bytes, now: float) -> None:
        """Forget everything up to now; of a token that is under way, its rest as well."""
        self.feed(data, now)
        self._headless = self._headless or bool(self._rest)
        self._rest = b""
        self._since = now

    def stale(self, now: float) -> str:
        """An unfinished token that is too old to be completed; it is thrown away."""
        if now - self._since <= PATIENCE_S:
            return ""
        token = self._take() if self._rest else ""
        self._headless = False
        return token

    def _take(self) -> str:
        rest, headless = self._rest, self._headless
        self._rest, self._headless = b"", False
        return "" if headless else rest.decode("ascii", errors="replace").strip("\0")
