"""A Moonraker server: the real one where it is installed, and a stand-in of the few paths used.

The printer behind the real one is a stand-in, too: it answers as Klipper does over its socket.
"""

from __future__ import annotations

import importlib.util
import json
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

MISSING = (
    None
    if importlib.util.find_spec("moonraker")
    else "Moonraker is not installed: pip install moonraker"
)
_CONFIG = """\
[server]
host: 127.0.0.1
port: {port}
klippy_uds_address: {socket}
[authorization]
trusted_clients: 127.0.0.1
[machine]
provider: none
validate_service: False
[file_manager]
check_klipper_config_path: False
[update_manager]
enable_auto_refresh: False
"""


class Klipper(threading.Thread):
    """What Moonraker asks of Klipper; `state` is that of the print."""

    def __init__(self, path: Path) -> None:
        super().__init__(daemon=True)
        self.state, self.asked = "standby", list[str]()
        self.server = socket.socket(socket.AF_UNIX)
        self.server.bind(str(path))
        self.server.listen()
        self.start()

    def run(self) -> None:
        while True:
            connection, _ = self.server.accept()
            threading.Thread(target=self.serve, args=(connection,), daemon=True).start()

    def serve(self, connection: socket.socket) -> None:
        left = b""
        while data := connection.recv(65536):
            *messages, left = (left + data).split(b"\x03")
            for message in map(json.loads, messages):
                self.asked.append(message["method"])
                if "id" in message:
                    reply = {"id": message["id"], "result": self.answer(message["method"])}
                    connection.sendall(json.dumps(reply).encode() + b"\x03")

    def answer(self, method: str) -> dict[str, Any]:
        if method == "info":
            names = ("hostname", "klipper_path", "python_path", "software_version", "cpu_info")
            return {
                **dict.fromkeys(names, "x"), "state": "ready", "state_message": "",
                "config_file": "/x/printer.cfg", "log_file": "/x/klippy.log", "process_id": 1,
            }  # fmt: skip
        if method == "list_endpoints":
            names = ("info", "objects/list", "objects/query", "objects/subscribe")
            return {"endpoints": [*names, "gcode/firmware_restart", "register_remote_method"]}
        if method == "objects/list":
            return {"objects": ["print_stats", "webhooks"]}
        if method.startswith("objects/"):
            status = {"print_stats": {"state": self.state}, "webhooks": {"state": "ready"}}
            return {"eventtime": 1.0, "status": status}
        return {}


class Moonraker:
    """The real server over a folder of its own."""

    def __init__(self, folder: Path, content: bytes) -> None:
        config = folder / "config"
        config.mkdir()
        self.file = config / "printer.cfg"
        self.file.write_bytes(content)
        self.klipper = Klipper(folder / "k.sock")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        text = _CONFIG.format(port=port, socket=folder / "k.sock")
        (config / "moonraker.conf").write_text(text, encoding="utf-8")
        self.address = f"http://127.0.0.1:{port}"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "moonraker", "-d", str(folder)],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        end = time.monotonic() + 30.0
        while not self.ready():
            assert time.monotonic() < end, "it did not start"
            time.sleep(0.2)

    def ready(self) -> bool:
        try:
            with urllib.request.urlopen(f"{self.address}/server/info", timeout=2) as answer:
                return bool(json.load(answer)["result"]["klippy_state"] == "ready")
        except OSError:
            return False

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait(20)


class StandIn(ThreadingHTTPServer):
    """A server that answers what it is told to, and keeps what was asked of it."""

    def __init__(self, **answers: Any) -> None:
        class Handler(BaseHTTPRequestHandler):
            server: ClassVar[StandIn]

            def do_GET(self) -> None:
                self.server.answer(self)

            do_POST = do_GET

            def log_message(self, *_: object) -> None:
                pass

        super().__init__(("127.0.0.1", 0), Handler)
        self.answers, self.asked = answers, list[tuple[str, str | None]]()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"

    def answer(self, asked: BaseHTTPRequestHandler) -> None:
        self.asked.append((asked.path, asked.headers.get("X-Api-Key")))
        name = asked.path.partition("?")[0].rpartition("/")[2].removesuffix(".cfg")
        found = self.answers.get(name, 404)
        if isinstance(found, int):
            asked.send_error(found)
            return
        body = found if isinstance(found, bytes) else json.dumps(found).encode()
        asked.send_response(200)
        asked.send_header("Content-Length", str(len(body) + self.answers.get("cut", 0)))
        asked.end_headers()
        asked.wfile.write(body)
