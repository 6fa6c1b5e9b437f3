"""Sounds that are no speech: CLAP names what is heard (thesis 6.7; Wu et al. 2023, "Large-scale Contrastive
Language-Audio Pretraining with Feature Fusion and Keyword-to-Caption Augmentation").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch
from scipy.signal import resample_poly
from transformers import ClapModel, ClapProcessor

from pentimento.semantics.pretrained import load_pretrained, unreadable
from pentimento.sound.recording import RATE_HZ, Recording, SoundError, check_level

_PROMPT: Final = "This is a sound of {}."
"""With which CLAP is evaluated on sounds by their names (Wu et al. 2023, section 4.3)."""
_NOTHING: Final = ("silence", "noise", "a person speaking")
"""Rivals of the things: where one of them fits best, nothing was named."""


@dataclass(frozen=True)
class SoundNamer:
    """A CLAP model with its processor and the things that it may name."""

    model: Any
    processor: Any
    things: tuple[str, ...]
    """Such as "a cat"."""

    @classmethod
    def load(cls, folder: Path, things: Sequence[str]) -> SoundNamer:
        """Read a folder in the published layout; nothing is downloaded.

        Raises:
            ConfigError: the folder holds something else, a part of a model or damaged weights.
        """
        model = load_pretrained(ClapModel, folder, "The CLAP model")
        with unreadable(f"The CLAP model in {folder}"):
            processor = ClapProcessor.from_pretrained(folder, local_files_only=True)
        return cls(model, processor, tuple(things))

    def similarities(self, recording: Recording, prompts: Sequence[str]) -> list[float]:
        """Cosine similarity of the recording to each prompt."""
        rate_hz = self.processor.feature_extractor.sampling_rate
        samples = resample_poly(recording.samples, rate_hz, RATE_HZ)
        inputs = self.processor(
            text=list(prompts), audio=samples, sampling_rate=rate_hz, return_tensors="pt", padding=True
        )
        with torch.inference_mode():
            found = self.model(**inputs)
        sound, words = (torch.nn.functional.normalize(each, dim=-1) for each in (found.audio_embeds, found.text_embeds))
        return [float(value) for value in words @ sound[0]]

    def name_of(self, recording: Recording) -> str:
        """The thing whose sound the recording is most like.

        Raises:
            SoundError: the recording is silent, or most like no thing's sound.
        """
        check_level(recording)
        candidates = (*self.things, *_NOTHING)
        similarities = self.similarities(recording, [_PROMPT.format(thing) for thing in candidates])
        best = max(range(len(candidates)), key=similarities.__getitem__)
        if candidates[best] in _NOTHING:
            raise SoundError(
                f"The recording sounds like {candidates[best]}, not like a thing that can be drawn; record another, or "
                "say the wish in words. Nothing was painted."
            )
        return candidates[best]
