"""A page for the person beside the robot: the canvas, the goal, the next strokes, and buttons that send commands.

The page is served on this computer alone (127.0.0.1), under an address with a secret token. A request without the token
gets nothing. The page loads nothing from other servers.
"""

from __future__ import annotations

import hmac
import json
import re
import secrets
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.contracts.images import encode_png
from pentimento.control.checkpoint import PaintingState
from pentimento.control.drawn import MAX_BYTES
from pentimento.control.expression import PLAIN, Expression
from pentimento.control.person import COMMANDS, Command, Control
from pentimento.control.pictures import CANVAS, GOAL, GOALS, NEXT, PHOTOGRAPH, PREVIEW
from pentimento.control.request_items import plain_text
from pentimento.control.undo import can_undo

_FILES = (GOAL, NEXT, PREVIEW, PHOTOGRAPH)
_SAVE = "save/"
_HEARD = re.compile(r"wish/([0-9]{1,6})")  # a wish that was heard, by the number of its recording
_GOAL = re.compile(rf"{GOALS}/[1-9]\.png")
_LAST_LOOK_S = 1.2  # an open page asks for the state every 0.5 s
_MAX_BYTES = 100_000  # of a request's body
_LIMITS = {"draw": MAX_BYTES, "listen": 2_000_000}  # half a minute of speech takes one megabyte
_MAX_DRAINED = 200_000_000  # bytes of a larger body that are read and thrown away
_TIMEOUT_S = 30.0  # for a browser that announces more than it sends
_CONTENT_POLICY = (
    "default-src 'none'; img-src 'self'; script-src 'self'; style-src 'self'; connect-src 'self'; form-action 'none'"
)
_CONTENT_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript",
    ".css": "text/css",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".gcode": "text/plain",
    ".zip": "application/zip",
}


@dataclass(frozen=True)
class Pen:
    """What a person draws with on the page."""

    width: float
    """Of its lines, in widths of the canvas."""
    color: str | None
    """As CSS has it; None where the person chooses."""


@dataclass(frozen=True)
class Response:
    """An HTTP response."""

    status: HTTPStatus
    content_type: str
    content: bytes


_NOT_FOUND = Response(HTTPStatus.NOT_FOUND, "text/plain", b"There is nothing here.\n")


class Page:
    """A server in its own thread, until ``close``."""

    def __init__(
        self,
        folder: Path,
        control: Control,
        pen: Pen | None = None,
        saved: Mapping[str, Callable[[], bytes]] | None = None,
        listen: Callable[[bytes], tuple[str, Expression]] | None = None,
        hands: Sequence[str] = (),
        port: int = 0,
    ) -> None:
        """Serve the painting in a folder; commands go to ``control``. Port 0 takes a free one.

        Args:
            pen: with which a person draws on the page; None where that is impossible.
            saved: functions that give the files to be saved, by their names.
            listen: from the content of a WAV file to the wish in it and how it is painted, or PentimentoError; None
                where nothing listens.
            hands: in which the person may let the robot draw.

        Raises OSError if the port is taken.
        """
        self._folder, self._control, self._saved = folder, control, saved or {}
        self._lock = threading.Lock()
        self._listen, self._listening = listen, threading.Lock()
        self._expressions: list[Expression] = []  # of the wishes that were heard
        self._token = secrets.token_urlsafe(16)
        self._state: dict[str, Any] = {}
        self._hands = list(hands)
        self._pen = None if pen is None else asdict(pen)
        self._version = 0
        self._seen = False
        self._lines = 0  # of the last line that was sent on
        self._handed_over = False  # an order waits that ends the person's turn
        self._canvas: NDArray[np.uint8] | None = None
        self._server = ThreadingHTTPServer(("127.0.0.1", port), _handler(self))
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """The address to open in a browser on this computer."""
        return f"http://127.0.0.1:{self._server.server_port}/{self._token}/"

    def show(self, state: PaintingState) -> None:
        """Show a new state."""
        with self._lock:
            if state.phase != "your turn" or not self._control.is_waiting():
                self._handed_over = False
            if state.phase != "your turn":
                self._lines = state.lines
        self._canvas = state.canvas
        self._version += 1
        self._state = {
            "version": self._version,
            "pen": self._pen,
            "hands": self._hands,
            "phase": state.phase,
            "message": state.message,
            "executed": state.executed,
            "total": state.executed + len(state.remaining),
            "turns": state.turns,
            "lines": state.lines,
            "undo": self._pen is not None and can_undo(self._folder, state),
            "choices": len(list((self._folder / GOALS).glob("*.png"))) if state.phase == "choosing" else 0,
        }

    def close(self) -> None:
        """Stop serving, when an open page has had the time to show the last state."""
        if self._seen:
            time.sleep(_LAST_LOOK_S)
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def get(self, path: str) -> Response:
        """The response to a GET of a path below the token."""
        self._seen = True
        if path == "state.json":
            state = self._state and self._state | {"hand": self._control.hand}
            return Response(HTTPStatus.OK, "application/json", json.dumps(state).encode())
        if path == CANVAS and self._canvas is not None:
            return Response(HTTPStatus.OK, "image/png", encode_png(self._canvas))
        if path in _FILES or _GOAL.fullmatch(path):
            file = self._folder / path
            if file.is_file():
                return Response(HTTPStatus.OK, "image/png", file.read_bytes())
        if path.startswith(_SAVE) and (give := self._saved.get(path.removeprefix(_SAVE))) is not None:
            return _given(give, _CONTENT_TYPES[Path(path).suffix])
        if path == "listens.json":
            return Response(HTTPStatus.OK, "application/json", json.dumps(self._listen is not None).encode())
        asset = {"": "page.html", "page.js": "page.js", "page.css": "page.css", "listen.js": "listen.js"}.get(path)
        if asset is not None:
            content = (resources.files("pentimento.control") / "web" / asset).read_bytes()
            return Response(HTTPStatus.OK, _CONTENT_TYPES[Path(asset).suffix], content)
        return _NOT_FOUND

    def post(self, path: str, body: bytes) -> Response:
        """Pass on what the body says: a command, the words of a wish, a hand, or the number of a goal."""
        if path == "listen" and self._listen is not None:
            return self._hear(self._listen, body)
        text = body.decode("utf-8", errors="replace").strip()
        command = next((known for known in COMMANDS if known == text), None)
        if path == "draw" and self._pen is not None:
            return self._draw(text)
        if path == "command" and command is not None:
            self._hand_over(command, "")
        elif (expression := self._expression_at(path)) is not None:
            try:
                self._hand_over("wish", plain_text(text), expression)
            except ConfigError as error:
                return _sentence(HTTPStatus.BAD_REQUEST, str(error))
        elif path == "hand" and text in ("", *self._hands):
            self._control.hand = text or None
        elif path == "choose" and text.isdecimal():
            self._control.send("choose", text)
        else:
            return _sentence(
                HTTPStatus.BAD_REQUEST,
                f"Send one of the commands {', '.join(COMMANDS)}, a wish, a hand of the bundle, or a goal's number.",
            )
        return Response(HTTPStatus.NO_CONTENT, "text/plain", b"")

    def _hand_over(self, command: Command, value: str, expression: Expression = PLAIN) -> None:
        with self._lock:
            self._handed_over = True
            self._control.send(command, value, expression)

    def _expression_at(self, path: str) -> Expression | None:
        """How a wish is painted that is sent to a path; None where no wishes are sent to."""
        heard = _HEARD.fullmatch(path)
        if heard is None:
            return PLAIN if path == "wish" else None
        return next(iter(self._expressions[int(heard[1]) :]), None)

    def _draw(self, line: str) -> Response:
        """Send a line on, and answer with its number among those of all pages; refuse it after the person's turn."""
        with self._lock:
            if self._handed_over or self._state.get("phase") != "your turn":
                return _sentence(HTTPStatus.CONFLICT, "Your last line was not drawn, because it is the robot's turn.")
            self._lines = max(self._lines, self._state["lines"]) + 1
            self._control.send("draw", line)
            return Response(HTTPStatus.OK, "application/json", json.dumps(self._lines).encode())

    def _hear(self, listen: Callable[[bytes], tuple[str, Expression]], sound: bytes) -> Response:
        """The words in a WAV file and how they are painted, for the person to confirm; nothing is sent to the robot."""
        try:
            with self._listening:  # a recogniser hears one recording at a time
                words, expression = listen(sound)
                self._expressions.append(expression)
                answer: dict[str, Any] = {"words": words, "wish": f"wish/{len(self._expressions) - 1}"}
            answer["how"] = expression.sentence() if expression != PLAIN else ""
            return Response(HTTPStatus.OK, "application/json", json.dumps(answer).encode())
        except PentimentoError as error:
            return _sentence(HTTPStatus.UNPROCESSABLE_ENTITY, str(error))

    def below_token(self, path: str) -> str | None:
        """The part of a path below the token; None where the token is wrong."""
        token, _, rest = path.partition("?")[0].removeprefix("/").partition("/")
        return rest if hmac.compare_digest(token.encode(), self._token.encode()) else None

    def is_own_host(self, host: str) -> bool:
        """Whether a request names this address, and not a host name that was rebound to it."""
        return host == f"127.0.0.1:{self._server.server_port}"


def _given(give: Callable[[], bytes], content_type: str) -> Response:
    """A file to be saved, or the sentence that says why there is none."""
    try:
        return Response(HTTPStatus.OK, content_type, give())
    except (PentimentoError, OSError) as error:
        return _sentence(HTTPStatus.CONFLICT, str(error))


def _sentence(status: HTTPStatus, text: str) -> Response:
    return Response(status, "text/plain; charset=utf-8", f"{text}\n".encode())


def _handler(page: Page) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        server_version, sys_version = "pentimento", ""
        timeout = _TIMEOUT_S

        def do_GET(self) -> None:
            self._respond(page.get)

        def do_POST(self) -> None:
            length = self.headers.get("Content-Length", "0")
            self._respond(lambda path: self._read_and_post(path, int(length) if length.isdecimal() else 0))

        def _read_and_post(self, path: str, length: int) -> Response:
            if length <= _LIMITS.get(path, _MAX_BYTES):
                return page.post(path, self.rfile.read(length))
            # Read to its end, so that the browser is there for the answer.
            left = min(length, _MAX_DRAINED)
            while left > 0 and (part := self.rfile.read(min(left, 2**16))):
                left -= len(part)
            return _sentence(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
                f"What was sent has {length / 1e6:.1f} MB, which is too much for this page; nothing of it was used.",
            )

        def log_message(self, format: str, *args: Any) -> None:
            """No log: the terminal shows the progress of the painting."""

        def _respond(self, respond: Callable[[str], Response]) -> None:
            path = page.below_token(self.path)
            own_host = page.is_own_host(self.headers.get("Host", ""))
            response = _NOT_FOUND if path is None or not own_host else respond(path)
            self.send_response(response.status)
            self.send_header("Content-Type", response.content_type)
            self.send_header("Content-Length", str(len(response.content)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", _CONTENT_POLICY)
            self.send_header("X-Content-Type-Options", "nosniff")
            self.send_header("Referrer-Policy", "no-referrer")
            self.send_header("X-Frame-Options", "DENY")
            self.end_headers()
            self.wfile.write(response.content)

    return Handler
