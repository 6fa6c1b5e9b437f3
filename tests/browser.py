"""A headless Chromium that tests drive through its DevTools protocol; it reaches nothing but this computer."""

import asyncio
import base64
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import aiohttp

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
_FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-extensions", "--disable-dev-shm-usage",
    "--remote-debugging-port=0", "--remote-debugging-address=127.0.0.1",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)  # fmt: skip


class Browser:
    """One tab."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse, loop: asyncio.AbstractEventLoop, port: int) -> None:
        self._socket, self._loop, self._port, self._last = socket, loop, port, 0

    @contextmanager
    def another(self) -> Iterator["Browser"]:
        """Another tab of the same browser."""
        session, socket = self._loop.run_until_complete(_connect(self._port, new=True))
        try:
            yield Browser(socket, self._loop, self._port)
        finally:
            self._loop.run_until_complete(_disconnect(session, socket))

    def goto(self, url: str) -> None:
        """Load an address, until its page says that it is complete."""
        self.call("Page.navigate", url=url)
        self.wait("document.readyState === 'complete'")

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, condition: str, seconds: float = 120.0) -> None:
        """Until a JavaScript condition holds."""
        end = time.monotonic() + seconds
        while not self.evaluate(f"Boolean({condition})"):
            assert time.monotonic() < end, f"never came true: {condition}; the page says: {self.text()[:2000]}"
            time.sleep(0.2)

    def text(self) -> str:
        """What a person can read on the page."""
        return str(self.evaluate("document.body ? document.body.innerText : ''"))

    def click(self, element: str) -> None:
        """Click, as a mouse does, in the middle of (the first line of) the element that an expression gives."""
        self.wait(element)
        place = self.evaluate(
            f"(e => {{ e.scrollIntoView({{block: 'center', behavior: 'instant'}}); const r = e.getClientRects()[0];"
            f" return [r.x + r.width / 2, r.y + r.height / 2]; }})({element})"
        )
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], button="left", clickCount=1)

    def tick(self, *boxes: str) -> None:
        """Click until all boxes that the expressions give are ticked; a page that is drawn again may miss a click."""
        end = time.monotonic() + 120
        while open_ := [box for box in boxes if not self.evaluate(f"Boolean(({box} || {{}}).checked)")]:
            assert time.monotonic() < end, f"never ticked: {open_[0]}; the page says: {self.text()[:2000]}"
            self.click(open_[0])
            time.sleep(0.5)

    def press(self, key: str, code: int, text: str = "") -> None:
        """Press and release a key, such as Enter, by its name and its Windows code."""
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code,
                **({"text": text} if kind == "keyDown" and text else {}),
            )  # fmt: skip

    def drag(self, element: str, places: list[tuple[float, float]]) -> None:
        """Draw a line by the mouse over the element that an expression gives; places in its widths and heights."""
        x, y, width, height = self.evaluate(
            f"(e => {{ e.scrollIntoView({{block: 'center', behavior: 'instant'}}); const r = e.getBoundingClientRect();"
            f" return [r.x, r.y, r.width, r.height]; }})({element})"
        )
        at = [(x + a * width, y + b * height) for a, b in places]
        kinds = ["mousePressed", *["mouseMoved"] * (len(at) - 1), "mouseReleased"]
        for kind, (left, top) in zip(kinds, [*at, at[-1]], strict=True):
            self.call("Input.dispatchMouseEvent", type=kind, x=left, y=top, button="left", buttons=1, clickCount=1)

    def screenshot(self, path: Path, whole: bool = False) -> None:
        """Write what is seen as PNG; `whole` for all of a page that is longer than the window."""
        answer = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole, **self._clip(whole))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(base64.b64decode(answer["data"]))

    def resize(self, width: int, height: int) -> None:
        """Of the window, in pixels."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command of the protocol and its answer."""
        return self._loop.run_until_complete(asyncio.wait_for(self._call(method, parameters), 60))

    def _clip(self, whole: bool) -> dict[str, Any]:
        if not whole:
            return {}
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        return {"clip": {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}}

    async def _call(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        self._last += 1
        await self._socket.send_str(json.dumps({"id": self._last, "method": method, "params": parameters}))
        while True:  # events come in between
            answer = json.loads(await self._socket.receive_str())
            if answer.get("id") == self._last:
                assert "error" not in answer, answer["error"]
                return dict(answer["result"])


@contextmanager
def browser(folder: Path, *flags: str) -> Iterator[Browser]:
    """A browser with its profile in `folder` and further flags; gone afterwards."""
    assert CHROMIUM is not None
    process = subprocess.Popen(
        [CHROMIUM, *_FLAGS, *flags, f"--user-data-dir={folder}", "about:blank"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    loop = asyncio.new_event_loop()
    try:
        port = _port(folder / "DevToolsActivePort")
        session, socket = loop.run_until_complete(_connect(port))
        try:
            tab = Browser(socket, loop, port)
            tab.resize(1500, 1000)
            yield tab
        finally:
            loop.run_until_complete(_disconnect(session, socket))
    finally:
        process.kill()  # its profile is thrown away
        process.wait()
        loop.close()


def _port(file: Path) -> int:
    end = time.monotonic() + 120
    while not (file.is_file() and file.read_text().count("\n")):
        assert time.monotonic() < end, "Chromium did not open its port"
        time.sleep(0.1)
    return int(file.read_text().splitlines()[0])


async def _connect(port: int, new: bool = False) -> tuple[aiohttp.ClientSession, aiohttp.ClientWebSocketResponse]:
    session = aiohttp.ClientSession()
    method, what = ("PUT", "new?about:blank") if new else ("GET", "list")
    async with session.request(method, f"http://127.0.0.1:{port}/json/{what}") as answer:
        targets = await answer.json()
    (page,) = [target for target in ([targets] if new else targets) if target["type"] == "page"]
    return session, await session.ws_connect(page["webSocketDebuggerUrl"], max_msg_size=0)


async def _disconnect(session: aiohttp.ClientSession, socket: aiohttp.ClientWebSocketResponse) -> None:
    await socket.close()
    await session.close()
