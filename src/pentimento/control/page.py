"""A small page for the person at the easel: the canvas, the goal, what comes next, and a word to the robot.

It is served on this computer alone (127.0.0.1), under an address that holds a secret token: who does not know it sees
nothing and says nothing. The page loads nothing from anywhere else.
"""

from __future__ import annotations

import hmac
import json
import secrets
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.images import encode_png
from pentimento.control.commands import WORDS, Control
from pentimento.control.painting_state import State
from pentimento.control.session import CANVAS, GOAL, NEXT, PREVIEW

_FILES = (GOAL, NEXT, PREVIEW)
_MAX_BYTES = 1000  # of what is posted
_ONLY_HERE = (
    "default-src 'none'; img-src 'self'; script-src 'self'; style-src 'self'; connect-src 'self'; form-action 'none'"
)
_KINDS = {".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css", ".png": "image/png"}


class Page:
    """A server in a thread of its own, from its making until ``close``."""

    def __init__(self, folder: Path, control: Control, port: int = 0) -> None:
        """Serve the painting in a folder; words go to ``control``. Port 0 takes one that is free.

        Raises OSError if the port is taken.
        """
        self._folder, self._control = folder, control
        self._token = secrets.token_urlsafe(16)
        self._state: dict[str, Any] = {}
        self._canvas: NDArray[np.uint8] | None = None
        self._server = ThreadingHTTPServer(("127.0.0.1", port), _handler(self))
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """What to open in a browser on this computer."""
        return f"http://127.0.0.1:{self._server.server_port}/{self._token}/"

    def tell(self, state: State) -> None:
        """Show a new state."""
        self._canvas = state.canvas
        self._state = {
            "phase": state.phase,
            "sentence": state.sentence,
            "made": state.made,
            "of": state.made + len(state.left),
            "turns": state.turns,
        }

    def close(self) -> None:
        """Serve no more."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def get(self, path: str) -> tuple[HTTPStatus, str, bytes]:
        """Status, kind and content of a path below the token."""
        if path == "state.json":
            return HTTPStatus.OK, "application/json", json.dumps(self._state).encode()
        if path == CANVAS and self._canvas is not None:
            return HTTPStatus.OK, "image/png", encode_png(self._canvas)
        if path in _FILES:
            file = self._folder / path
            if file.is_file():
                return HTTPStatus.OK, "image/png", file.read_bytes()
        asset = {"": "page.html", "page.js": "page.js", "page.css": "page.css"}.get(path)
        if asset is not None:
            content = (resources.files("pentimento.control") / "web" / asset).read_bytes()
            return HTTPStatus.OK, _KINDS[Path(asset).suffix], content
        return HTTPStatus.NOT_FOUND, "text/plain", b"There is nothing here.\n"

    def post(self, path: str, body: bytes) -> tuple[HTTPStatus, str, bytes]:
        """Hear a word, given as the body."""
        word = next((known for known in WORDS if known.encode() == body), None)
        if path != "say" or word is None:
            return HTTPStatus.BAD_REQUEST, "text/plain", f"Say one of: {', '.join(WORDS)}.\n".encode()
        self._control.say(word)
        return HTTPStatus.NO_CONTENT, "text/plain", b""

    def below_token(self, path: str) -> str | None:
        """What a path asks for below the token; None where the token is another."""
        token, _, rest = path.partition("?")[0].removeprefix("/").partition("/")
        return rest if hmac.compare_digest(token.encode(), self._token.encode()) else None

    def is_here(self, host: str) -> bool:
        """Whether a request was meant for this very address, not for a name that was bent to it."""
        return host == f"127.0.0.1:{self._server.server_port}"


def _handler(page: Page) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        server_version, sys_version = "pentimento", ""

        def do_GET(self) -> None:
            self._answer(page.get)

        def do_POST(self) -> None:
            length = self.headers.get("Content-Length", "0")
            small = length.isdigit() and int(length) <= _MAX_BYTES
            body = self.rfile.read(int(length)) if small else b""
            self._answer(lambda path: page.post(path, body))

        def log_message(self, format: str, *args: Any) -> None:
            """Nothing: the terminal belongs to the painting."""

        def _answer(self, respond: Any) -> None:
            path = page.below_token(self.path)
            if path is None or not page.is_here(self.headers.get("Host", "")):
                status, kind, content = HTTPStatus.NOT_FOUND, "text/plain", b"There is nothing here.\n"
            else:
                status, kind, content = respond(path)
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", _ONLY_HERE)
            self.send_header("X-Content-Type-Options", "nosniff")
            self.send_header("Referrer-Policy", "no-referrer")
            self.send_header("X-Frame-Options", "DENY")
            self.end_headers()
            self.wfile.write(content)

    return Handler
