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
    from pentimento.control.expression import Expression
    from pentimento.sound.affect import Heard, Listener


def heard_in(file: Path, bundle: Path, model: Path | None) -> Heard:
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


def expression_for(heard: Heard, bundle: Path, setting: str) -> Expression:
    """How a wish is painted in a bundle's setting. Raises BundleError where the bundle is refused."""
    from pentimento.bundle.reader import open_bundle
    from pentimento.control.expression import has_free_colours
    from pentimento.sound.affect import expression_of

    opened = open_bundle(bundle)
    free = has_free_colours(opened.tools[setting], opened.setting(setting).planner)
    return expression_of(heard, free_colours=free)


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


def page_listener(bundle: Path, setting: str, model: Path | None) -> Callable[[bytes], tuple[str, Expression]] | None:
    """From a WAV file's content to the wish in it and how it is painted in a bundle's setting, for the page; None where
    nothing that listens is installed.

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

    def hear(content: bytes) -> tuple[str, Expression]:
        heard = listener()(recording_of(content, "The recording"))
        return heard.words, expression_for(heard, bundle, setting)

    return hear


def listener_for(vocabulary: Vocabulary | None, model: Path | None) -> Listener:
    """What turns a recording into words; `model` is the folder of a published model.

    Raises:
        ConfigError: as `heard_in`.
    """
    if model is None:
        from pentimento.sound.affect import spoken
        from pentimento.sound.speech import Recogniser

        return spoken(Recogniser(vocabulary).words_of)
    with workshop("listen with a published model"):
        from pentimento.hearing.published import load_listener
    return load_listener(model, vocabulary)
