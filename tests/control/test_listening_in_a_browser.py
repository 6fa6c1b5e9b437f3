"""A wish is spoken on the page, in a real browser with a microphone that plays a file."""

from __future__ import annotations

import http.client
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from pentimento.control.expression import PLAIN, Expression
from pentimento.control.page import Page
from pentimento.control.person import Control, Order
from pentimento.sound.recording import Recording, SoundError, read_recording, recording_of
from tests.browser import CHROMIUM, Browser, browser
from tests.bundle.line_brush import sheet
from tests.control.painting_bundle import small_vocabulary
from tests.control.paintings import begun
from tests.sound.spoken import ESPEAK, speak, tone, wav

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
LIVELY = Expression("fast", chroma=1.3, lightness=0.0, length=1.2, tempo=1.2)
SPEAK = "document.getElementById('speak')"


@contextmanager
def served(folder: Path, listen: Callable[[bytes], tuple[str, Expression]] | None) -> Iterator[tuple[Page, Control]]:
    control = Control()
    folder.mkdir()
    state = begun(sheet(), folder)
    page = Page(folder, control, listen=listen)
    page.show(state)
    try:
        yield page, control
    finally:
        page.close()


def post(page: Page, body: bytes, path: str = "listen") -> tuple[int, str]:
    _, _, place, token, _ = page.address.split("/")
    connection = http.client.HTTPConnection(place, timeout=30)
    connection.request("POST", f"/{token}/{path}", body=body)
    answer = connection.getresponse()
    content = answer.status, answer.read().decode()
    connection.close()
    return content


def received(control: Control) -> Order:
    """The order that the page sends, within 10 s."""
    for _ in range(200):
        if (order := control.poll()) is not None:
            return order
        time.sleep(0.05)
    raise AssertionError("The page sent nothing.")


def microphone(file: Path) -> tuple[str, ...]:
    """Flags of a browser whose microphone plays a file once and again."""
    return ("--use-fake-device-for-media-stream", f"--use-file-for-fake-audio-capture={file}")


def allow(tab: Browser, page: Page, setting: str) -> None:
    origin = page.address.split("/", 3)
    tab.call("Browser.setPermission", permission={"name": "microphone"}, setting=setting, origin="/".join(origin[:3]))


@needs_browser
def test_a_recording_reaches_the_server_as_it_was_played_and_its_words_wait_in_the_field(tmp_path: Path) -> None:
    got: list[Recording] = []

    def listen(content: bytes) -> tuple[str, Expression]:
        got.append(recording_of(content, "The recording"))
        return "a cat", LIVELY

    file = tmp_path / "tone.wav"
    file.write_bytes(wav((32767 * tone(4.0, 48_000)).astype(np.int16), 48_000))
    with served(tmp_path / "painting", listen) as (page, control), browser(tmp_path / "x", *microphone(file)) as tab:
        tab.resize(390, 844)  # a phone's
        allow(tab, page, "granted")
        tab.goto(page.address)
        tab.click(SPEAK)
        tab.wait(f"{SPEAK}.getAttribute('aria-pressed') === 'true'")
        tab.evaluate("new Promise(done => setTimeout(done, 1500))")
        tab.click(SPEAK)
        tab.wait("document.getElementById('words').value === 'a cat'")
        assert "Heard: a cat" in tab.text() and "press Ask" in tab.text()
        assert control.poll() is None  # nothing happens before the person confirms
        (recording,) = got
        middle = recording.samples[len(recording.samples) // 4 : -len(recording.samples) // 4]
        loudest = np.abs(np.fft.rfft(middle * np.hanning(len(middle)))).argmax() * 16_000 / len(middle)
        assert recording.duration_s > 1.0 and abs(loudest - 440.0) < 5.0
        tab.click("document.querySelector('#wish button')")
        order = received(control)
        assert (order.command, order.value, order.expression) == ("wish", "a cat", LIVELY)
        tab.wait("!document.querySelector('#as-said').checkVisibility()")  # the next wish may be typed
        tab.evaluate(
            "document.getElementById('words').value = 'a dog'; document.getElementById('wish').requestSubmit()"
        )
        assert received(control).expression == PLAIN


@needs_browser
def test_a_spoken_wish_is_painted_like_a_typed_one_where_the_person_says_so(tmp_path: Path) -> None:
    file = tmp_path / "tone.wav"
    file.write_bytes(wav((32767 * tone(4.0, 48_000)).astype(np.int16), 48_000))
    heard = iter([("a cat", LIVELY), ("a dog", PLAIN)])
    flags = microphone(file)
    with (
        served(tmp_path / "painting", lambda _: next(heard)) as (page, control),
        browser(tmp_path / "x", *flags) as tab,
    ):
        allow(tab, page, "granted")
        tab.goto(page.address)
        for words, said in (("a cat", True), ("a dog", False)):
            tab.click(SPEAK)
            tab.wait(f"{SPEAK}.getAttribute('aria-pressed') === 'true'")
            tab.evaluate("new Promise(done => setTimeout(done, 500))")
            tab.click(SPEAK)
            tab.wait(f"document.getElementById('words').value === '{words}'")
            assert tab.evaluate("document.getElementById('as-said').checkVisibility()") is said
            assert (LIVELY.sentence() in tab.text()) is said
            if said:
                tab.screenshot(tmp_path / "said.png")
                tab.click("document.getElementById('as-said')")
            tab.click("document.querySelector('#wish button')")
            order = received(control)
            assert (order.value, order.expression) == (words, PLAIN)


def test_a_wish_is_painted_as_its_own_recording_says(tmp_path: Path) -> None:
    heard = iter([("a cat", LIVELY), ("a dog", PLAIN)])
    with served(tmp_path / "painting", lambda _: next(heard)) as (page, control):
        answers = [json.loads(post(page, b"sound")[1]) for _ in range(2)]
        assert answers[0] == {"words": "a cat", "how": LIVELY.sentence(), "wish": "wish/0"}
        assert answers[1] == {"words": "a dog", "how": "", "wish": "wish/1"}
        for path, expression in (("wish/0", LIVELY), ("wish/1", PLAIN), ("wish", PLAIN)):
            assert post(page, b"a cow", path)[0] == 204
            order = control.poll()
            assert order is not None and (order.value, order.expression) == ("a cow", expression)
        for path in ("wish/2", "wish/-1", "wish/", "wish/0/0", "wish/9999999"):  # never heard
            assert post(page, b"a cow", path)[0] == 400 and control.poll() is None


@needs_browser
def test_what_is_not_understood_or_not_allowed_is_one_sentence(tmp_path: Path) -> None:
    def listen(content: bytes) -> tuple[str, Expression]:
        raise SoundError("No wish is understood.")

    file = tmp_path / "tone.wav"
    file.write_bytes(wav((32767 * tone(2.0, 48_000)).astype(np.int16), 48_000))
    with served(tmp_path / "painting", listen) as (page, control), browser(tmp_path / "x", *microphone(file)) as tab:
        allow(tab, page, "denied")
        tab.goto(page.address)
        tab.click(SPEAK)
        tab.wait("document.body.innerText.includes('may not use the microphone')")
        allow(tab, page, "granted")
        tab.click(SPEAK)
        tab.wait(f"{SPEAK}.getAttribute('aria-pressed') === 'true'")
        tab.evaluate("new Promise(done => setTimeout(done, 500))")
        tab.click(SPEAK)
        tab.wait("document.body.innerText.includes('No wish is understood.')")
        assert tab.evaluate("document.getElementById('words').value") == "" and control.poll() is None


@needs_browser
def test_without_a_recogniser_there_is_no_button(tmp_path: Path) -> None:
    with served(tmp_path / "painting", None) as (page, _), browser(tmp_path / "x") as tab:
        tab.goto(page.address)
        tab.wait("document.getElementById('message').innerText !== ''")
        tab.evaluate("new Promise(done => setTimeout(done, 500))")
        assert tab.evaluate(SPEAK) is None
        assert post(page, b"sound")[0] == 400


def test_uploads_that_are_no_speech_are_one_sentence_and_no_wish(tmp_path: Path) -> None:
    def listen(content: bytes) -> tuple[str, Expression]:
        return f"{recording_of(content, 'The recording').duration_s:.0f} s", PLAIN

    with served(tmp_path / "painting", listen) as (page, control):
        assert json.loads(post(page, wav(tone(1.0, 16_000), 16_000))[1])["words"] == "1 s"
        for body in (b"", b"no sound", wav(tone(1.0, 16_000), 16_000)[:-7]):
            status, sentence = post(page, body)
            assert status == 422 and sentence.startswith("The recording ") and sentence.count("\n") == 1
        status, sentence = post(page, bytes(100_000_000))
        assert status == 413 and "100.0 MB" in sentence
        assert control.poll() is None
        status, _ = post(page, wav(tone(1.0, 16_000), 16_000))
        assert status == 200  # the page goes on


@needs_browser
@pytest.mark.skipif(ESPEAK is None, reason="needs espeak-ng")
def test_a_spoken_wish_is_recognised_on_the_page(tmp_path: Path) -> None:
    pytest.importorskip("pocketsphinx", reason="needs the extra voice")
    from pentimento.sound.speech import Recogniser

    recogniser = Recogniser(small_vocabulary())
    read = read_recording(speak("two cats", tmp_path / "spoken.wav"))
    pause = np.zeros(8000, np.float32)
    file = tmp_path / "microphone.wav"
    file.write_bytes(wav((32767 * np.concatenate([pause, read.samples, pause, pause])).astype(np.int16), 16_000))

    def listen(content: bytes) -> tuple[str, Expression]:
        return recogniser.words_of(recording_of(content, "The recording")), PLAIN

    flags = ("--use-fake-device-for-media-stream", f"--use-file-for-fake-audio-capture={file}%noloop")
    with served(tmp_path / "painting", listen) as (page, _), browser(tmp_path / "x", *flags) as tab:
        allow(tab, page, "granted")
        tab.goto(page.address)
        tab.click(SPEAK)
        tab.wait(f"{SPEAK}.getAttribute('aria-pressed') === 'true'")
        tab.evaluate("new Promise(done => setTimeout(done, 3000))")
        tab.click(SPEAK)
        tab.wait("document.getElementById('words').value === 'two cats'", 30)
        tab.screenshot(tmp_path / "page.png")
