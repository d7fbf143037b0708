"""A stand-in of a Moonraker server, of the few paths used."""

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, ClassVar


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
