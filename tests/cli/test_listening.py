"""`pentimento run --listen`: a spoken wish is painted, and other sounds are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pentimento.cli.listening import confirmed, page_listener
from pentimento.cli.main import main
from pentimento.contracts.codec import to_plain
from pentimento.contracts.errors import ConfigError
from tests.control.painting_bundle import small_vocabulary, write_painting_bundle
from tests.sound.spoken import ESPEAK, speak, tone, wav

pytest.importorskip("pocketsphinx", reason="needs the extra voice")
needs_speech = pytest.mark.skipif(ESPEAK is None, reason="needs espeak-ng")


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_painting_bundle(tmp_path_factory.mktemp("bundle") / "bundle", small_vocabulary())


@needs_speech
def test_a_spoken_wish_is_painted_and_another_one_after_it(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, first, second = tmp_path / "out", tmp_path / "first.wav", tmp_path / "second.wav"
    assert main(["run", str(bundle), "--listen", str(speak("a dog", first)), "--strokes", "2", "--out", str(out)]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "Heard: a dog"
    assert json.loads((out / "commission.json").read_text())["wanted"] == {"kind": "words", "value": "a dog"}
    assert main(["run", "--resume", str(out), "--listen", str(speak("two cats", second))]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "Heard: two cats"
    assert json.loads((out / "turns/001.json").read_text())["words"] == "two cats"


@needs_speech
def test_a_wish_that_is_said_fast_is_painted_fast_unless_it_is_as_typed(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, fast, typed = speak("a dog", tmp_path / "fast.wav", words_per_minute=260), tmp_path / "a", tmp_path / "b"
    wish = ["run", str(bundle), "--listen", str(file), "--strokes", "2"]
    assert main([*wish, "--out", str(fast)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Heard: a dog" and "fast: " in lines[1] and lines[1].endswith("faster.")
    assert "colours" not in lines[1]  # a pen has its own
    commission, turn = (json.loads((fast / name).read_text()) for name in ("commission.json", "turns/000.json"))
    assert commission["expression"] == turn["expression"] and turn["expression"]["tempo"] > 1
    assert main([*wish, "--as-typed", "--out", str(typed)]) == 0
    assert "Said" not in capsys.readouterr().out
    assert json.loads((typed / "turns/000.json").read_text())["expression"]["tempo"] == 1
    assert main(["run", "--resume", str(typed), "--listen", str(file)]) == 0
    assert json.loads((typed / "turns/001.json").read_text())["expression"] == turn["expression"]
    listen = page_listener(bundle, commission["setting"], None)
    assert listen is not None
    words, expression = listen(file.read_bytes())
    assert words == "a dog" and to_plain(expression) == turn["expression"]


def test_as_typed_needs_something_to_hear(bundle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["run", str(bundle), "--out", "nowhere", "--goal-text", "a cat", "--as-typed"])
    assert "--as-typed" in capsys.readouterr().err


def test_a_file_without_speech_leaves_no_folder(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "sound.wav"
    for content in (b"", b"no sound", wav(np.zeros(16_000, np.int16), 16_000), wav(tone(2.0, 48_000), 48_000)):
        file.write_bytes(content)
        assert main(["run", str(bundle), "--listen", str(file), "--out", str(tmp_path / "out")]) == 1
        printed = capsys.readouterr()
        assert printed.out == "" and len(printed.err.splitlines()) == 1
        assert not (tmp_path / "out").exists()


def test_listening_excludes_other_goals(bundle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for other in (["--goal-text", "a cat"], ["--goal-image", "cat.png"], ["--material", "foam", "--letter", "A"]):
        with pytest.raises(SystemExit):
            main(["run", str(bundle), "--out", "nowhere", "--listen", "wish.wav", *other])
        assert "--listen" in capsys.readouterr().err


def test_a_sound_model_needs_something_to_hear(bundle: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["run", str(bundle), "--out", "nowhere", "--goal-text", "a cat", "--sound-model", "whisper"])
    assert "--sound-model" in capsys.readouterr().err


def test_a_folder_without_a_sound_model_is_one_sentence(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "sound.wav"
    file.write_bytes(wav(tone(1.0, 16_000), 16_000))
    wish = ["--listen", str(file), "--sound-model", str(tmp_path / "nowhere")]
    assert main(["run", str(bundle), *wish, "--out", str(tmp_path / "out")]) == 1
    printed = capsys.readouterr()
    assert "no folder of a published model" in printed.err and len(printed.err.splitlines()) == 1
    assert not (tmp_path / "out").exists()
    assert main(["studio", str(bundle), "--sound-model", str(tmp_path), "--out", str(tmp_path / "out")]) == 1
    assert "no folder of a published model" in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize(("answers", "expected"), [(["y"], True), (["maybe", "n"], False)])
def test_person_at_the_terminal_confirms_what_was_heard(
    monkeypatch: pytest.MonkeyPatch, answers: list[str], expected: bool
) -> None:
    given = iter(answers)
    monkeypatch.setattr("builtins.input", lambda _question: next(given))
    assert confirmed(is_at_terminal=True, executes=True) is expected


def test_end_of_input_is_no_confirmation(monkeypatch: pytest.MonkeyPatch) -> None:
    def end(_question: str) -> str:
        raise EOFError

    monkeypatch.setattr("builtins.input", end)
    assert confirmed(is_at_terminal=True, executes=False) is False


def test_without_a_terminal_hardware_does_not_move_by_what_was_heard() -> None:
    assert confirmed(is_at_terminal=False, executes=False)
    with pytest.raises(ConfigError, match="after you confirmed it at a terminal"):
        confirmed(is_at_terminal=False, executes=True)
