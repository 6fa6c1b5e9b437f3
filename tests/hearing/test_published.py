"""Published models listen from a folder; their weights here are random, so only the way through them is tested."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from safetensors.torch import load_file, save_file

from pentimento.contracts.errors import ConfigError
from pentimento.hearing.clap import SoundNamer
from pentimento.hearing.published import load_listener
from pentimento.hearing.whisper import Transcriber
from pentimento.sound.recording import Recording, SoundError
from tests.control.painting_bundle import small_vocabulary
from tests.hearing.models import write_clap, write_whisper
from tests.sound.spoken import tone


@pytest.fixture(scope="module")
def whisper(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_whisper(tmp_path_factory.mktemp("whisper"))


@pytest.fixture(scope="module")
def clap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clap(tmp_path_factory.mktemp("clap"))


SOUND = Recording(tone(2.0, 16_000))
SILENCE = Recording(np.zeros(16_000, np.float32))


def test_whisper_writes_down_what_it_hears(whisper: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listener = load_listener(whisper, None)
    try:
        heard = listener(SOUND)
        assert heard.words == listener(SOUND).words != "" and heard.manner is not None
    except SoundError as error:
        assert "No words" in str(error)  # random weights may say only signs
    transcriber = Transcriber.load(whisper)
    said = transcriber.processor.tokenizer("a cat beside a tree").input_ids
    monkeypatch.setattr(transcriber.model, "generate", lambda *_, **__: [said])
    assert transcriber.words_of(SOUND) == "a cat beside a tree"
    monkeypatch.setattr(
        transcriber.model, "generate", lambda *_, **__: [transcriber.processor.tokenizer(" ...").input_ids]
    )
    with pytest.raises(SoundError, match="No words"):
        transcriber.words_of(SOUND)


def test_clap_picks_the_prompt_that_is_most_like_the_sound(clap: Path) -> None:
    namer = SoundNamer.load(clap, ["a cat", "a dog"])
    similarities = namer.similarities(SOUND, ["a cat", "a dog", "a cat"])
    assert similarities[0] == pytest.approx(similarities[2], abs=1e-6) and similarities[0] != similarities[1]
    assert all(-1 <= value <= 1 for value in similarities)
    louder = Recording(0.5 * SOUND.samples)
    assert namer.similarities(louder, ["a cat"])[0] == pytest.approx(similarities[0], abs=0.2)


@pytest.mark.parametrize(("best", "heard"), [(0, "a cat"), (1, "a dog"), (2, None), (3, None), (4, None)])
def test_clap_names_a_thing_or_says_what_it_heard(
    clap: Path, best: int, heard: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    namer = SoundNamer.load(clap, ["a cat", "a dog"])
    prompts: list[str] = []

    def similarities(_self: SoundNamer, _recording: Recording, given: list[str]) -> list[float]:
        prompts.extend(given)
        return [float(number == best) for number in range(len(given))]

    monkeypatch.setattr(SoundNamer, "similarities", similarities)
    if heard is None:
        with pytest.raises(SoundError, match="sounds like"):
            namer.name_of(SOUND)
    else:
        assert namer.name_of(SOUND) == heard
    assert prompts[:2] == ["This is a sound of a cat.", "This is a sound of a dog."]


def test_clap_names_things_of_the_bundle_only(clap: Path) -> None:
    listener = load_listener(clap, small_vocabulary())
    try:
        heard = listener(SOUND)
        assert heard.words in ("a cat", "a dog") and heard.manner is None  # a sound is not said in any manner
    except SoundError as error:
        assert "sounds like" in str(error)
    with pytest.raises(ConfigError, match="knows all words"):
        load_listener(clap, None)


@pytest.mark.parametrize("kind", ["whisper", "clap"])
def test_silence_is_refused_before_the_model_hears_it(kind: str, request: pytest.FixtureRequest) -> None:
    listener = load_listener(request.getfixturevalue(kind), small_vocabulary())
    with pytest.raises(SoundError, match="silent"):
        listener(SILENCE)


def test_folders_that_hold_something_else_are_one_sentence(whisper: Path, clap: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no folder of a published model"):
        load_listener(tmp_path / "nowhere", None)
    (tmp_path / "config.json").write_text("[]")
    with pytest.raises(ConfigError, match="no folder of a published model"):
        load_listener(tmp_path, None)
    (tmp_path / "config.json").write_text('{"model_type": "bert"}')
    with pytest.raises(ConfigError, match="'bert'"):
        load_listener(tmp_path, None)
    for kind, folder in (("Whisper", whisper), ("CLAP", clap)):
        (tmp_path / "config.json").write_text(json.dumps(json.loads((folder / "config.json").read_text())))
        with pytest.raises(ConfigError, match=f"The {kind} model in .* cannot be read") as error:
            load_listener(tmp_path, small_vocabulary())
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", ["whisper", "clap"])
def test_a_model_that_is_not_whole_is_refused(kind: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    folder = shutil.copytree(request.getfixturevalue(kind), tmp_path / kind)
    weights = load_file(folder / "model.safetensors")
    save_file(dict(sorted(weights.items())[3:]), folder / "model.safetensors", {"format": "pt"})
    with pytest.raises(ConfigError, match="lacks weights, such as"):
        load_listener(folder, small_vocabulary())
    (folder / "model.safetensors").write_text("version https://git-lfs.github.com/spec/v1\n")
    with pytest.raises(ConfigError, match="is a pointer and not the file"):
        load_listener(folder, small_vocabulary())
