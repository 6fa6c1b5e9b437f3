"""A published model in a local folder, as what listens in place of the embedded recogniser."""

from __future__ import annotations

import json
from pathlib import Path

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.errors import ConfigError
from pentimento.hearing.clap import SoundNamer
from pentimento.hearing.whisper import Transcriber
from pentimento.semantics.pretrained import check_pointers
from pentimento.sound.affect import Heard, Listener, spoken


def load_listener(folder: Path, vocabulary: Vocabulary | None) -> Listener:
    """The model in a folder of the published layout: Whisper, or CLAP with a bundle's vocabulary.

    Raises:
        ConfigError: the folder does not exist or holds something else; or CLAP is to name things that no vocabulary
            lists.
    """
    try:
        check_pointers(folder)
        config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
        kind = config.get("model_type")
    except (OSError, ValueError, AttributeError, ConfigError) as error:
        raise ConfigError(
            f"{folder} is no folder of a published model ({error}); give one with config.json, model.safetensors and "
            "the files of its processor, as openai/whisper-base.en or laion/clap-htsat-unfused has."
        ) from error
    if kind == "whisper":
        return spoken(Transcriber.load(folder).words_of)
    if kind != "clap":
        raise ConfigError(f"{folder} holds a model of type {kind!r}; to listen it must be of type 'whisper' or 'clap'.")
    if vocabulary is None:
        raise ConfigError(
            "The bundle's goal planner knows all words, so nothing lists the things that CLAP could hear; use Whisper."
        )
    namer = SoundNamer.load(folder, [noun.one for noun in vocabulary.nouns.values()])
    return lambda recording: Heard(namer.name_of(recording))  # a cat's voice says nothing of the wish
