"""Speech to words by Whisper (Radford et al. 2022, "Robust Speech Recognition via Large-Scale Weak Supervision")."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch
from transformers import WhisperForConditionalGeneration, WhisperProcessor

from pentimento.semantics.pretrained import load_pretrained, unreadable
from pentimento.sound.recording import RATE_HZ, Recording, SoundError, check_level

_MAX_TOKENS: Final = 100
"""Of a wish's words; 200 characters have fewer."""


@dataclass(frozen=True)
class Transcriber:
    """A Whisper model with its processor."""

    model: Any
    processor: Any

    @classmethod
    def load(cls, folder: Path) -> Transcriber:
        """Read a folder in the published layout; nothing is downloaded.

        Raises:
            ConfigError: the folder holds something else, a part of a model or damaged weights.
        """
        model = load_pretrained(WhisperForConditionalGeneration, folder, "The Whisper model")
        with unreadable(f"The Whisper model in {folder}"):
            processor = WhisperProcessor.from_pretrained(folder, local_files_only=True)
        return cls(model, processor)

    def words_of(self, recording: Recording) -> str:
        """The words, in English.

        Raises:
            SoundError: the recording is silent, or the model hears no words.
        """
        check_level(recording)
        inputs = self.processor(recording.samples, sampling_rate=RATE_HZ, return_tensors="pt")
        options = {"language": "en", "task": "transcribe"} if self.model.generation_config.is_multilingual else {}
        with torch.inference_mode():
            tokens = self.model.generate(inputs.input_features, max_new_tokens=_MAX_TOKENS, do_sample=False, **options)
        words = " ".join(self.processor.batch_decode(tokens, skip_special_tokens=True)[0].split())
        if not any(letter.isalnum() for letter in words):
            raise SoundError("No words are heard in the recording; say the wish again. Nothing was painted.")
        return words
