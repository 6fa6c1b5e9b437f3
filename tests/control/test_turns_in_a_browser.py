"""A person and the studio's robot draw in turns by the page, in a real browser."""

import threading
from pathlib import Path

import numpy as np
import pytest

from pentimento.control.checkpoint import PaintingState, load_state
from pentimento.control.page import Page, Pen
from pentimento.control.person import Control
from pentimento.control.session import resume
from tests.browser import CHROMIUM, browser
from tests.bundle.line_brush import journaled_sheet
from tests.control.paintings import begun, session_of
from tests.control.test_session import bars, two_bars

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")


@pytest.mark.timeout(240)
def test_person_asks_chooses_and_stops_by_mouse_and_keyboard(tmp_path: Path) -> None:
    folder, control = tmp_path / "painting", Control()
    folder.mkdir()
    robot = journaled_sheet(folder)
    begun(robot, folder)
    page = Page(folder, control, Pen(0.02, "#202020"))
    session = session_of(
        robot,
        folder,
        control,
        page.show,
        goals_for=two_bars,
        in_turns=True,
        in_studio=True,
    )
    control.send("your turn")
    ended: list[PaintingState] = []
    painting = threading.Thread(target=lambda: ended.append(resume(session)), daemon=True)
    painting.start()
    try:
        with browser(tmp_path / "profile") as tab:
            tab.resize(390, 844)  # a phone's
            tab.goto(page.address)
            tab.wait("document.body.innerText.includes('It is your turn')")
            tab.wait("document.querySelector('#lines.active') && document.getElementById('canvas').clientHeight > 100")
            blank = load_state(folder).canvas
            tab.drag("document.getElementById('lines')", [(0.2, 0.2), (0.5, 0.3), (0.8, 0.2)])
            tab.wait("received === 1 && sent.length === 0")
            drawn = blank.min(-1).astype(int) - load_state(folder).canvas.min(-1) > 60
            assert drawn.sum() > 25 and np.flatnonzero(drawn.any(1)).max() < 0.4 * len(drawn)
            tab.click("document.getElementById('words')")
            tab.call("Input.insertText", text="a bar on the right")
            tab.click("document.querySelector('#wish button')")
            tab.wait("document.querySelectorAll('#goals img').length === 2")
            tab.wait("[...document.querySelectorAll('#goals img')].every(i => i.naturalWidth > 0)")
            assert tab.evaluate("document.documentElement.scrollWidth") <= 390
            tab.screenshot(tmp_path / "choosing.png", whole=True)
            tab.click("document.querySelectorAll('#goals button')[1]")
            tab.wait("document.querySelector('#goals').hidden")
            tab.goto(page.address)  # a reload in the middle
            tab.wait("document.body.innerText.includes('It is your turn')")
            asked = load_state(folder)
            assert asked.executed > 0 and len(asked.remaining) == 0
            tab.click("[...document.querySelectorAll('nav button')].find(b => b.innerText === 'Stop')")
            painting.join(60)
            page.close()
            tab.wait("document.body.innerText.includes('The painting has ended')")
    finally:
        control.send("stop")
    (done,) = ended
    assert done.phase == "done"
    assert (done.goal == bars(done.goal)[1]).all()  # the second one of them
