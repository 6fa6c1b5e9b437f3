"""The person's page: its content, its commands, and the requests that it refuses."""

from __future__ import annotations

import http.client
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.images import decode_png, write_png
from pentimento.control.checkpoint import load_state
from pentimento.control.page import Page, Pen
from pentimento.control.person import Control, Order
from pentimento.control.undo import remember
from tests.bundle.line_brush import sheet
from tests.control.paintings import begun


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[Page, Control]]:
    control = Control()
    state = begun(sheet(), tmp_path)
    page = Page(tmp_path, control)
    page.show(state)
    yield page, control
    page.close()


def _ask(
    page: Page,
    path: str,
    method: str = "GET",
    body: str | None = None,
    host: str | None = None,
    token: str | None = None,
) -> tuple[int, bytes, dict[str, str]]:
    _, _, place, own, _ = page.address.split("/")
    connection = http.client.HTTPConnection(place, timeout=5)
    headers = {} if host is None else {"Host": host}
    connection.request(method, f"/{own if token is None else token}/{path}", body=body, headers=headers)
    answer = connection.getresponse()
    content = answer.read(), dict(answer.getheaders())
    connection.close()
    return answer.status, *content


def test_page_is_served_on_localhost_only(served: tuple[Page, Control]) -> None:
    assert served[0].address.startswith("http://127.0.0.1:")


def test_page_serves_state_and_pictures(served: tuple[Page, Control]) -> None:
    page, _ = served
    status, text, headers = _ask(page, "")
    assert status == 200 and b"<title>Pentimento</title>" in text
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    state = json.loads(_ask(page, "state.json")[1])
    assert state["executed"] == 0 and state["total"] > 0 and state["phase"] == "painting"
    for name in ("canvas.png", "goal.png", "next.png?1", "preview.png"):
        status, content, _ = _ask(page, name)
        assert status == 200 and decode_png(content).ndim == 3
    assert _ask(page, "page.js")[0] == _ask(page, "page.css")[0] == 200


def test_page_gives_files_to_save_or_one_sentence(tmp_path: Path) -> None:
    def nothing() -> bytes:
        raise ConfigError("Nothing is drawn yet.")

    page = Page(tmp_path, Control(), saved={"painting.svg": lambda: b"<svg/>", "painting.gcode": nothing})
    status, content, headers = _ask(page, "save/painting.svg")
    assert (status, content, headers["Content-Type"]) == (200, b"<svg/>", "image/svg+xml")
    assert _ask(page, "save/painting.gcode")[:2] == (409, b"Nothing is drawn yet.\n")
    for path in ("save/other", "save/", "save/../state.npz"):
        assert _ask(page, path)[0] == 404
    page.close()


def test_page_accepts_known_commands_only(served: tuple[Page, Control]) -> None:
    page, control = served
    assert _ask(page, "command", "POST", "your turn")[0] == 204
    assert control.poll() == Order("your turn")
    for path, body in (("command", "explode"), ("command", ""), ("unknown", "stop"), ("command", "stop" * 1000)):
        assert _ask(page, path, "POST", body)[0] == 400
    assert control.poll() is None
    assert _ask(page, "command")[0] == 404
    assert control.poll() is None


def test_page_passes_on_wishes_and_choices(served: tuple[Page, Control]) -> None:
    page, control = served
    assert _ask(page, "wish", "POST", " ein Bär ".encode().decode("latin-1"))[0] == 204
    assert control.poll() == Order("wish", "ein Bär")
    assert _ask(page, "choose", "POST", "2")[0] == 204
    assert control.poll() == Order("choose", "2")
    for path, body in (("choose", "two"), ("choose", "")):
        assert _ask(page, path, "POST", body)[0] == 400
    assert control.poll() is None


def test_page_offers_the_hands_of_the_bundle(tmp_path: Path) -> None:
    control, state = Control(), begun(sheet(), tmp_path)
    page = Page(tmp_path, control, hands=("anna", "bert"))
    page.show(state)
    told = json.loads(_ask(page, "state.json")[1])
    assert (told["hands"], told["hand"]) == (["anna", "bert"], None)
    assert _ask(page, "hand", "POST", "bert")[0] == 204 and control.hand == "bert"
    assert json.loads(_ask(page, "state.json")[1])["hand"] == "bert"
    assert _ask(page, "hand", "POST", "carl")[0] == 400 and control.hand == "bert"
    assert _ask(page, "hand", "POST", "")[0] == 204 and control.hand is None
    assert control.poll() is None  # it is no order: the robot goes on
    page.close()


def test_page_offers_undo_where_the_studio_has_a_batch_to_undo(tmp_path: Path) -> None:
    control, state = Control(), begun(sheet(), tmp_path)
    (tmp_path / "journal.jsonl").write_text("")
    remember(tmp_path, 0, 0)
    for pen, executed, expected in ((Pen(0.02, None), 3, True), (Pen(0.02, None), 0, False), (None, 3, False)):
        page = Page(tmp_path, control, pen)
        page.show(replace(state, executed=executed))
        assert json.loads(_ask(page, "state.json")[1])["undo"] is expected
        page.close()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("", "The request is empty"),
        ("  ", "The request is empty"),
        ("a" * 10_000, "The request has 10000 characters; say in at most 200"),
        ("a c\x00at", "control or invisible character"),
    ],
)
def test_wish_that_cannot_be_read_is_one_sentence_and_is_not_passed_on(
    served: tuple[Page, Control], words: str, sentence: str
) -> None:
    page, control = served
    status, content, _ = _ask(page, "wish", "POST", words)
    assert status == 400 and sentence in content.decode() and content.count(b"\n") == 1
    assert control.poll() is None


def test_emoji_is_passed_on_as_it_is(served: tuple[Page, Control]) -> None:
    page, control = served
    assert _ask(page, "wish", "POST", "🐈 🐈".encode().decode("latin-1"))[0] == 204
    assert control.poll() == Order("wish", "🐈 🐈")


def test_upload_of_100_mb_is_one_sentence(served: tuple[Page, Control]) -> None:
    page, control = served
    for path in ("wish", "draw", "command", "nothing"):
        status, content, _ = _ask(page, path, "POST", "a" * 100_000_000)
        assert status == 413 and content == (
            b"What was sent has 100.0 MB, which is too much for this page; nothing of it was used.\n"
        )
    assert control.poll() is None
    assert _ask(page, "state.json")[0] == 200


def test_lines_of_two_pages_are_numbered_together_until_the_turn_is_handed_over(tmp_path: Path) -> None:
    control, state = Control(), begun(sheet(), tmp_path)
    page = Page(tmp_path, control, Pen(0.02, None))
    page.show(replace(state, phase="painting"))
    assert _ask(page, "draw", "POST", "1")[:2] == (
        409, b"Your last line was not drawn, because it is the robot's turn.\n",
    )  # fmt: skip
    page.show(replace(state, phase="your turn", lines=4))
    assert [_ask(page, "draw", "POST", "1")[:2] for _ in range(2)] == [(200, b"5"), (200, b"6")]
    page.show(replace(state, phase="your turn", lines=5))
    assert _ask(page, "draw", "POST", "1")[:2] == (200, b"7")
    _ask(page, "wish", "POST", "florb")
    page.show(replace(state, phase="your turn", lines=6))  # of a line before the wish
    assert _ask(page, "draw", "POST", "1")[0] == 409
    while control.poll():
        pass
    page.show(replace(state, phase="your turn", lines=7))  # the wish was not understood
    assert _ask(page, "draw", "POST", "1")[:2] == (200, b"8")
    page.close()


def test_page_shows_goals_only_while_one_is_to_be_chosen(served: tuple[Page, Control], tmp_path: Path) -> None:
    page, _ = served
    state = load_state(tmp_path)
    for number in (1, 2, 3):
        write_png(tmp_path / "goals" / f"{number}.png", state.canvas)
    for phase, choices in (("choosing", 3), ("painting", 0)):
        page.show(replace(state, phase=phase))
        assert json.loads(_ask(page, "state.json")[1])["choices"] == choices
    assert decode_png(_ask(page, "goals/3.png")[1]).shape == state.canvas.shape
    assert _ask(page, "goals/4.png")[0] == _ask(page, "goals/../commission.json")[0] == 404


@pytest.mark.parametrize("token", ["", "x", "..", "%2e%2e"])
def test_page_refuses_requests_without_the_token(served: tuple[Page, Control], token: str) -> None:
    page, control = served
    assert _ask(page, "state.json", token=token)[0] == 404
    assert _ask(page, "command", "POST", "stop", token=token)[0] == 404
    assert control.poll() is None


def test_page_refuses_a_rebound_host_name(served: tuple[Page, Control]) -> None:
    page, control = served
    assert _ask(page, "command", "POST", "stop", host="example.org")[0] == 404
    assert control.poll() is None


@pytest.mark.parametrize("path", ["state.npz", "../state.npz", "record/part-00000.parquet", "page.html", "%2e%2e/x"])
def test_page_serves_no_other_file_of_the_folder(served: tuple[Page, Control], path: str) -> None:
    assert _ask(served[0], path)[0] == 404


def test_page_before_the_first_state(tmp_path: Path) -> None:
    page = Page(tmp_path, Control())
    assert _ask(page, "goal.png")[0] == 404 and _ask(page, "canvas.png")[0] == 404
    assert json.loads(_ask(page, "state.json")[1]) == {}
    write_png(tmp_path / "goal.png", np.zeros((2, 2, 3), np.uint8))
    assert _ask(page, "goal.png")[0] == 200
    page.close()


def test_page_files_refer_to_no_other_server() -> None:
    for file in (resources.files("pentimento.control") / "web").iterdir():
        assert not re.search(r"(https?:)?//[a-z]", file.read_text(encoding="utf-8"))
