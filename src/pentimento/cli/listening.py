"""What `pentimento run` and `studio` hear: by the embedded recogniser, or by a published model in a folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from pentimento.cli import workshop
from pentimento.cli.calibrate import yes_at_terminal
from pentimento.contracts.errors import ConfigError

if TYPE_CHECKING:
    from pentimento.bundle.vocabulary import Vocabulary
    from pentimento.sound.recording import Listener


def heard_in(file: Path, bundle: Path, model: Path | None) -> str:
    """The wish in a WAV file, for a bundle's goal planner.

    Raises:
        SoundError: the file cannot be read, or no wish is heard.
        ConfigError: the recogniser or the workshop is not installed, or the model's folder holds something else.
        BundleError: the bundle is refused.
    """
    from pentimento.bundle.reader import open_bundle
    from pentimento.sound.recording import read_recording

    recording = read_recording(file)
    return listener_for(open_bundle(bundle).vocabulary, model)(recording)


def confirmed(*, is_at_terminal: bool, executes: bool) -> bool:
    """Whether the person at the terminal confirms what was heard; without a terminal, only the studio goes on.

    Raises:
        ConfigError: hardware is to move, and nobody can confirm.
    """
    if is_at_terminal:
        try:
            return yes_at_terminal("Shall this be painted?")
        except EOFError:
            return False
    if executes:
        raise ConfigError(
            "What was heard may be wrong, so hardware moves only after you confirmed it at a terminal; or give the "
            "words with --goal-text."
        )
    return True


def page_listener(bundle: Path, model: Path | None) -> Callable[[bytes], str] | None:
    """From a WAV file's content to the wish in it, for the page; None where nothing that listens is installed.

    The recogniser is loaded when it is needed first; a model in a folder at once.

    Raises:
        ConfigError, BundleError: as `heard_in`.
    """
    if model is None and find_spec("pocketsphinx") is None:
        return None
    from pentimento.bundle.reader import open_bundle
    from pentimento.sound.recording import recording_of

    @cache
    def listener() -> Listener:
        return listener_for(open_bundle(bundle).vocabulary, model)

    if model is not None:
        listener()
    return lambda content: listener()(recording_of(content, "The recording"))


def listener_for(vocabulary: Vocabulary | None, model: Path | None) -> Listener:
    """What turns a recording into words; `model` is the folder of a published model.

    Raises:
        ConfigError: as `heard_in`.
    """
    if model is None:
        from pentimento.sound.speech import Recogniser

        return Recogniser(vocabulary).words_of
    with workshop("listen with a published model"):
        from pentimento.hearing.published import load_listener
    return load_listener(model, vocabulary)
