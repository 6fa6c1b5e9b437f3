"""A whole duet in a real browser: three turns by mouse and keyboard, two tabs, a reload, undo, a kill, and a resume."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from pentimento.contracts.images import decode_png
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.control.checkpoint import PaintingState, load_state
from pentimento.control.recording import RECORD
from pipelines._imports import ROOT
from tests.browser import CHROMIUM, Browser, browser
from tests.control.painting_bundle import small_vocabulary, write_painting_bundle

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")

SHEET = "document.getElementById('lines')"
DEAD = "document.body.innerText.includes('The painting has ended')"


class Studio:
    """`pentimento` in a process of its own, until it ends or is killed."""

    def __init__(self, *arguments: str | Path) -> None:
        program = "import sys; from pentimento.cli.main import main; sys.exit(main(sys.argv[1:]))"
        self.process = subprocess.Popen(
            [sys.executable, "-c", program, *map(str, arguments)], cwd=ROOT, stdout=subprocess.PIPE, text=True,
            env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        )  # fmt: skip
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip().removeprefix("The page is ")

    def end(self) -> tuple[int, str]:
        """The exit status and what was printed, when it has ended by itself."""
        printed, _ = self.process.communicate(timeout=60)
        return self.process.returncode, printed

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.communicate()


def button(name: str) -> str:
    return f"[...document.querySelectorAll('nav button')].find(b => b.dataset.command === '{name}')"


def opened(tab: Browser, address: str, folder: Path) -> PaintingState:
    """The state when the page of an address says that it is the person's turn."""
    tab.call("Page.bringToFront")
    tab.goto(address)
    return at_turn(tab, folder)


def at_turn(tab: Browser, folder: Path) -> PaintingState:
    tab.wait(f"document.body.innerText.includes('It is your turn') && {SHEET}.clientHeight > 100 && pen !== null")
    return load_state(folder)


def ask(tab: Browser, words: str) -> None:
    """Ask by the keyboard alone, and choose the second goal."""
    tab.call("Page.bringToFront")
    tab.evaluate("document.getElementById('words').focus()")
    tab.call("Input.insertText", text=words)
    tab.press("Enter", 13, "\r")
    tab.wait("document.querySelectorAll('#goals img').length === 3")
    tab.wait("document.activeElement.innerText === 'Goal 1'")
    tab.press("Tab", 9)
    tab.press("Enter", 13, "\r")


@pytest.mark.timeout(400)
def test_duet_of_three_turns_in_two_tabs_survives_undo_and_a_kill(tmp_path: Path) -> None:
    bundle = write_painting_bundle(tmp_path / "bundle", small_vocabulary(), hands=("anna", "bert"))
    folder, pictures = tmp_path / "duet", Path(os.environ.get("PENTIMENTO_SCREENSHOTS", tmp_path))
    studio = Studio("studio", bundle, "--out", folder, "--seed", "5")
    try:
        with browser(tmp_path / "profile") as tab, tab.another() as other:
            tab.resize(360, 780)
            blank = opened(tab, studio.address, folder).canvas.astype(int)
            assert tab.evaluate("[...document.querySelectorAll('.plan')].every(f => f.hidden)")  # nothing is planned
            # Turn 1: a line that leaves the sheet is drawn as far as the person sees it.
            tab.drag(SHEET, [(0.2, 0.8), (0.6, 0.8), (1.3, 0.8)])
            tab.wait("received === 1 && sent.length === 0")
            drawn = blank.min(-1) - load_state(folder).canvas.min(-1) > 60
            rows = drawn.any(1).nonzero()[0] / len(drawn)
            assert drawn.sum() > 10 and rows.min() > 0.6 and rows.max() < 0.95
            ask(tab, "a cat")
            tab.wait("document.querySelector('#goals').hidden")
            first = at_turn(tab, folder)
            assert first.executed > 0 and first.turns == 1
            tab.screenshot(pictures / "duet_360.png", whole=True)
            assert tab.evaluate("document.documentElement.scrollWidth") <= 360
            # A reload in the middle, and two people who draw at once.
            assert opened(tab, studio.address, folder).executed == first.executed
            opened(other, studio.address, folder)
            for number, each in enumerate((tab, other, tab, other)):
                each.call("Page.bringToFront")
                each.drag(SHEET, [(0.1, 0.1 + 0.2 * number), (0.4, 0.1 + 0.2 * number)])
            for each in (tab, other):
                each.call("Page.bringToFront")
                each.wait("received === 5 && sent.length === 0")
            # Turn 2, in the other tab, in a hand that is chosen by the keyboard; its batch is undone, and it is told to
            # go on.
            other.evaluate("document.getElementById('hand').focus()")
            other.press("ArrowDown", 40)
            tab.call("Page.bringToFront")
            tab.wait("document.getElementById('hand').value === 'anna'")  # the other tab shows it, too
            ask(other, "a dog")
            assert at_turn(other, folder).hand == "anna"
            before = load_state(folder)
            other.click(button("undo"))
            other.wait("document.body.innerText.includes('undone')")
            undone = at_turn(other, folder)
            assert undone.executed < before.executed and undone.turns == before.turns == 2
            assert not other.evaluate("document.querySelector('.plan').hidden")
            other.screenshot(pictures / "duet_undone.png", whole=True)
            other.click(button("go on"))
            _until(lambda: load_state(folder).turns == 3)  # strokes may be too fast for the page to show them
            studio.kill()
            for each in (tab, other):
                each.call("Page.bringToFront")
                each.wait(DEAD)
                assert each.evaluate("[...document.querySelectorAll('button')].every(b => b.disabled)")
            # Turn 3, after a resume at a new address; the old tab stays as it is.
            studio = Studio("run", "--resume", folder, "--turns", "--choices", "3", "--page")
            resumed = opened(tab, studio.address, folder)
            assert resumed.turns == 3 and resumed.lines == 5 and resumed.hand == "anna"
            _draw_by_keys(tab)
            tab.wait("received === 6 && sent.length === 0")
            ask(tab, "a cat")
            third = at_turn(tab, folder)
            assert third.turns == 4 and third.executed > resumed.executed
            tab.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path / "saved"))
            names = ["painting.gcode", "painting.png", "painting.svg", "recording.zip", "replay.html"]
            for name in names:
                tab.click(f"document.querySelector('#save a[href$=\"{name}\"]')")
            _until(lambda: sorted(path.name for path in (tmp_path / "saved").glob("*.*")) == names)
            tab.resize(1200, 900)
            tab.screenshot(pictures / "duet_end.png", whole=True)
            tab.click(button("stop"))
            tab.wait(DEAD)
            assert other.evaluate(DEAD)
    finally:
        studio.kill() if studio.process.poll() is None and sys.exc_info()[0] else None
    code, printed = studio.end()
    assert code == 0 and f"{third.executed} strokes are made" in printed
    table = read_table(folder / RECORD, CONTRACT).table
    orders = table["order"].to_pylist()
    assert orders == sorted(set(orders)) and orders[-1] == third.executed - 1
    assert len(orders) >= third.executed - 1  # a stroke that was made when the process was killed has no photograph
    assert (folder / "painting.svg").read_text().count("<path") >= third.executed + 6
    assert min(decode_png((folder / "painting.png").read_bytes()).shape[:2]) >= 800
    assert (tmp_path / "saved" / "painting.svg").read_bytes() == (folder / "painting.svg").read_bytes()
    asked = [json.loads(path.read_text())["words"] for path in sorted((folder / "turns").glob("*.json"))]
    assert [words for words in asked if words] == ["a cat", "a dog", "a cat"]


def _until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.2)


def _draw_by_keys(tab: Browser) -> None:
    """A short line to the right from the middle."""
    tab.evaluate(f"{SHEET}.focus()")
    tab.press(" ", 32, " ")
    for _ in range(8):
        tab.press("ArrowRight", 39)
    tab.press(" ", 32, " ")
