"""A printer's Moonraker server: its printer.cfg read, written, and its firmware restarted.

By Moonraker's "External API". A key that the server may want is taken from the environment and
sent to this server only.
"""

import os
import re
from collections.abc import Callable
from contextlib import closing, suppress
from threading import Thread
from typing import TypeVar

from orthoglide_cal.errors import InputError, UsageError, system_words, visible

KEY = "MOONRAKER_API_KEY"
PORT = 7125
_TIMEOUT_S = 10.0  # between two of its bytes
WHOLE_S = 30.0  # for a question and all of its answer
T = TypeVar("T")
_LARGEST = 5_000_000  # bytes of an answer
_CONFIG = "/server/files/config/printer.cfg"
_IDLE = ("standby", "complete", "cancelled", "error")
_OTHER = f"Give the address of Moonraker; its port is usually {PORT}."
_ADDRESS = re.compile(r"(https?)://([^/?#@:\[\]\s]+|\[[0-9a-f:.]+\])(?::([0-9]{1,5}))?/*")


def server(path: str) -> str | None:
    """The address that a path names, with its port; None for a file. Raises UsageError."""
    if not path.lower().startswith(("http://", "https://")):
        return None
    address = _ADDRESS.fullmatch(path.lower())
    if address is None or not 0 < int(address[3] or PORT) < 65536:
        raise UsageError(f"{path} is not the address of a server.", "Write http://HOST[:PORT].")
    scheme, host, port = address.groups()
    return f"{scheme}://{host}:{port or (PORT if scheme == 'http' else 443)}"


def printer_cfg(address: str) -> bytes:
    """The printer.cfg of a server. Raises InputError: not reached, or no Moonraker."""
    _asked(address, "/server/info", "klippy_state")
    return _request(address, _CONFIG)


def check_idle(address: str) -> None:
    """Raise UsageError while the printer prints."""
    if _asked(address, "/server/info", "klippy_state") != "ready":
        return  # nothing can print, and a file that keeps it from starting can be restored
    state = _asked(address, "/printer/objects/query?print_stats", "status", "print_stats", "state")
    if state not in _IDLE:
        problem = f"The printer at {address} is {state}."
        raise UsageError(problem, "Nothing was changed. Wait until it is idle.")


def upload(address: str, data: bytes) -> None:
    """Put a printer.cfg in the place of the server's; what it holds then counts, not its answer.

    Raises UsageError: the printer prints; InputError: the server does not hold it afterwards.
    """
    check_idle(address)
    mark = "----orthocal-" + os.urandom(16).hex()
    form = f"--{mark}\r\nContent-Disposition: form-data; name="
    head = f'{form}"root"\r\n\r\nconfig\r\n{form}"file"; filename="printer.cfg"\r\n\r\n'
    body = head.encode() + data + f"\r\n--{mark}--\r\n".encode()
    problem = "The server holds another printer.cfg than the one just sent."
    remedy = "Look at the file there before anything is homed."
    try:
        _request(address, "/server/files/upload", body, f"multipart/form-data; boundary={mark}")
    except InputError as error:  # a server that is slow may have stored it all the same
        problem, remedy = f"{error.what} So far it holds the old printer.cfg.", error.remedy
    if _request(address, _CONFIG) != data:
        raise InputError(problem, remedy, file=address)


def restart(address: str) -> None:
    """Restart the firmware, so that it reads its file. Raises UsageError, InputError."""
    check_idle(address)
    _request(address, "/printer/firmware_restart", b"")


def in_time(exchange: Callable[[], T], seconds: float) -> T:
    """The value of a call that may never end. Raises what it raises, or TimeoutError."""
    from concurrent.futures import Future

    future = Future[T]()

    def run() -> None:
        try:
            future.set_result(exchange())
        except Exception as error:
            future.set_exception(error)

    Thread(target=run, daemon=True).start()  # it ends with the program at the latest
    try:
        return future.result(seconds)
    except TimeoutError:
        raise TimeoutError("timed out") from None


def _asked(address: str, path: str, *keys: str) -> object:
    """Value under these keys of the `result` of an answer in JSON. Raises InputError."""
    value = _value(_request(address, path), "result", *keys)
    if value is None:
        problem = f"The server there is not Moonraker, or does not report its {keys[-1]}."
        raise InputError(problem, _OTHER, file=address)
    return value


def _value(answer: bytes, *keys: str) -> object:
    """Value under these keys of an answer in JSON; None if it has nothing there."""
    import json

    with suppress(ValueError, KeyError, TypeError, RecursionError):
        value = json.loads(answer)
        for key in keys:
            value = value[key]
        return value
    return None


def _request(address: str, path: str, body: bytes | None = None, kind: str = "") -> bytes:
    """The answer to a request; one with a body is a POST. Raises InputError."""
    from http.client import HTTPConnection, HTTPException, HTTPSConnection

    scheme, _, host = address.partition("://")
    # A printer is in the same network: no proxy knows it.
    made = HTTPSConnection if scheme == "https" else HTTPConnection
    connection = made(host, timeout=_TIMEOUT_S)
    headers = {"Content-Type": kind, "X-Api-Key": os.environ.get(KEY, "")}
    given = {name: value for name, value in headers.items() if value}

    def exchange() -> tuple[int, str, bytes]:
        # Closed by who reads: to close what another thread reads waits for all that it reads.
        with closing(connection):
            connection.request("GET" if body is None else "POST", path, body, given)
            answer = connection.getresponse()
            data = answer.read(_LARGEST + 1)
            if len(data) < min(int(answer.headers.get("Content-Length", 0)), _LARGEST):
                raise HTTPException("the answer was cut off")
            return answer.status, answer.reason, data

    try:
        status, words, data = in_time(exchange, WHOLE_S)
    except (OSError, HTTPException, ValueError) as error:
        reason = visible(system_words(error)).strip() or "cut off"
        reason = "no answer in time" if "timed out" in reason else reason
        remedy = "Check the address, the port, and that the printer is switched on."
        raise InputError(f"The server cannot be read: {reason}.", remedy, file=address) from error
    problem, remedy = f"The server answers {status} {visible(words)}.", "Check the address."
    if status in (403, 503) and (answer := _value(data, "error", "message")):
        reason = visible(str(answer))[:300].removesuffix(".")
        problem = f"The server refuses it ({status}): {reason}."
        remedy = "Look at the server and at Klipper's log."
    elif status in (401, 403):
        problem = f"The server wants a key ({status})."
        remedy = f"Set the environment variable to its API key: {KEY}."
    elif status == 404 and path == _CONFIG:
        problem, remedy = "The server has no printer.cfg.", "Check that Klipper runs there."
    elif len(data) > _LARGEST:
        problem, remedy = "The server there is not Moonraker.", _OTHER
    elif 200 <= status < 300:
        return data
    raise InputError(problem, remedy, file=address)
