"""How well spoken wishes are recognised: `python -m studies.spoken_wishes`, some ten minutes of one core.

espeak-ng speaks 60 wishes with three voices; pink noise is added at two levels. Compared are the recogniser of
`pentimento run --listen`, which refuses what it is not sure of, its search for wishes alone, which answers always, and
free text without the taught words. A wish counts as understood where the request made of the heard words equals that of
the true ones. Beside them: silence, noises, and wishes in other languages, all of which should be refused. The voices
that the recogniser's threshold was chosen with are others.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.errors import ConfigError
from pentimento.control.request import understand
from pentimento.deploy.words import taught_vocabulary
from pentimento.sound.recording import RATE_HZ, Recording, SoundError, read_recording
from pentimento.sound.speech import Hypothesis, Recogniser

VOICES: Final = ("en-us", "en-gb", "en-us+f4")
SNR_DB: Final = (30.0, 15.0)
"""Power of the speech over that of the noise: a quiet room, and a loud one."""
WORDS_PER_MINUTE: Final = 150
WISHES: Final = (
    "a cat", "a dog", "an elephant", "a guitar", "a bicycle", "a butterfly", "a castle", "a penguin", "an umbrella",
    "a snowman", "a rocket", "a tree", "a house", "a horse", "a mushroom", "a strawberry", "a turtle", "a windmill",
    "a lighthouse", "a violin", "two cats", "three fish", "four apples", "two birds", "three bananas", "two rabbits",
    "three balloons", "four ducks", "two boats", "three flowers", "a cat beside a tree", "a bird on a house",
    "a dog under a table", "a kite above a mountain", "a rabbit next to a carrot", "a horse in front of a castle",
    "a boat below a cloud", "a sheep behind a fence", "a spider in a bucket", "a star over a church",
    "a monkey and a banana", "a camel and a palm tree", "a crocodile and a frog", "a tiger with a hat",
    "a penguin with an umbrella", "two dogs and a cat", "a cow, a pig and a horse", "three birds above a tree",
    "a bee to the left of a flower", "a car to the right of a house", "a fox between a tree and a house",
    "draw a lion", "please draw a whale", "draw me a bus", "paint a sunflower", "please paint a moon over a boat",
    "can you draw a giraffe", "i want a pizza", "draw a picture of a train", "i would like an owl on a chair",
)  # fmt: skip
FOREIGN: Final = {
    "German": ("de", (
        "eine Katze", "ein Hund", "ein Elefant", "ein Fahrrad", "eine Gitarre", "drei Fische", "zwei Vögel", "ein Haus",
        "eine Katze neben einem Baum", "ein Vogel auf einem Haus", "ein Hund unter einem Tisch",
        "die Sonne über dem Meer",
        "ein Pferd vor einem Schloss", "bitte zeichne einen Löwen", "ich möchte einen Wal", "male mir einen Bus",
        "zwei Hunde und eine Katze", "ein Stern über der Kirche", "vier Äpfel", "ein Pinguin mit einem Regenschirm",
    )),
    "French": ("fr", (
        "un chat", "un chien", "un éléphant", "un vélo", "une guitare", "trois poissons", "deux oiseaux", "une maison",
        "un chat à côté d'un arbre", "un oiseau sur une maison", "un chien sous une table", "le soleil sur la mer",
        "un cheval devant un château", "dessine un lion", "je voudrais une baleine", "peins-moi un bus",
        "deux chiens et un chat", "une étoile au-dessus de l'église", "quatre pommes", "un pingouin avec un parapluie",
    )),
    "Spanish": ("es", (
        "un gato", "un perro", "un elefante", "una bicicleta", "una guitarra", "tres peces", "dos pájaros", "una casa",
        "un gato al lado de un árbol", "un pájaro sobre una casa", "un perro debajo de una mesa", "el sol sobre el mar",
        "un caballo delante de un castillo", "dibuja un león", "quiero una ballena", "píntame un autobús",
        "dos perros y un gato", "una estrella encima de la iglesia", "cuatro manzanas", "un pingüino con un paraguas",
    )),
}  # fmt: skip
VARIANTS: Final = ("", "+f2", "+m4")
"""Of the voices of other languages."""
NOISES: Final = ("white noise", "pink noise", "hum", "clicks", "tones", "hands that clap")


@dataclass(frozen=True)
class Score:
    """Of a recogniser's words."""

    errors: int = 0
    words: int = 0
    understood: int = 0
    refused: int = 0
    wishes: int = 0

    def added(self, true: str, heard: str | None, vocabulary: Vocabulary) -> Score:
        """With one more wish; None for one that was refused."""
        spoken_words = true.replace(",", "").split()
        right = heard is not None and _is_the_same(true, heard, vocabulary)
        return Score(
            self.errors + edits(spoken_words, [] if heard is None else heard.split()), self.words + len(spoken_words),
            self.understood + right, self.refused + (heard is None), self.wishes + 1,
        )  # fmt: skip

    def cells(self) -> str:
        """Word error rate, understood, misunderstood, refused."""
        shares = (self.understood, self.wishes - self.understood - self.refused, self.refused)
        return " | ".join([f"{self.errors / self.words:.2f}", *(f"{share / self.wishes:.0%}" for share in shares)])


def edits(true: list[str], heard: list[str]) -> int:
    """Minimum number of words that are put in, left out or replaced."""
    row = list(range(len(heard) + 1))
    for at, word in enumerate(true, 1):
        above, row = row, [at] + [0] * len(heard)
        for place, other in enumerate(heard, 1):
            row[place] = min(above[place] + 1, row[place - 1] + 1, above[place - 1] + (word != other))
    return row[-1]


def spoken(words: str, voice: str) -> NDArray[np.float32]:
    """Samples of espeak-ng's speech, with .4 s of silence around it."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "speech.wav"
        subprocess.run(["espeak-ng", "-v", voice, "-s", str(WORDS_PER_MINUTE), "-w", str(file), words], check=True)
        return np.pad(read_recording(file).samples, round(0.4 * RATE_HZ))


def noisy(samples: NDArray[np.float32], snr_db: float, rng: np.random.Generator) -> Recording:
    """The samples with pink noise."""
    noise = pink(len(samples), rng)
    loud = samples[np.abs(samples) > 0.01]  # without the pauses
    scale = np.sqrt((loud**2).mean() / (noise**2).mean()) * 10 ** (-snr_db / 20)
    return Recording(np.clip(samples + scale * noise, -1, 1).astype(np.float32))


def pink(count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Noise with a power that falls by 3 dB an octave."""
    spectrum = np.fft.rfft(rng.normal(size=count))
    return np.fft.irfft(spectrum / np.sqrt(np.maximum(np.arange(len(spectrum)), 1)), count)


def noise(kind: str, number: int) -> Recording:
    """Two seconds of a noise."""
    rng, count = np.random.default_rng(number), 2 * RATE_HZ
    t_s = np.arange(count) / RATE_HZ
    faint = 0.001 * rng.normal(size=count)
    if kind == "white noise":
        samples = rng.normal(size=count)
    elif kind == "pink noise":
        samples = pink(count, rng)
    elif kind == "hum":
        samples = sum(np.sin(2 * np.pi * 50 * k * t_s) / k for k in (1, 2, 3, 5)) + faint
    elif kind == "clicks":
        samples = faint.copy()
        samples[rng.integers(0, count, 20)] = 1.0
    elif kind == "tones":
        hertz = np.repeat(rng.uniform(200, 900, 4), count // 4)
        samples = np.sin(2 * np.pi * np.cumsum(hertz) / RATE_HZ) + faint
    else:
        envelope = np.zeros(count)
        for start in np.sort(rng.integers(0, count - 2000, 5)):
            envelope[start : start + 2000] = np.exp(-np.arange(2000) / 300)
        samples = envelope * rng.normal(size=count) + faint
    return Recording((0.3 * samples / np.abs(samples).max()).astype(np.float32))


def words_or_none(recogniser: Recogniser, recording: Recording) -> str | None:
    """The accepted words."""
    try:
        return recogniser.words_of(recording)
    except SoundError:
        return None


def accepted(recogniser: Recogniser) -> Iterator[tuple[str, int, int]]:
    """Of each kind of recording that should be refused: its name, the number accepted, and all."""
    silence = [np.zeros(2 * RATE_HZ), *(1e-4 * np.random.default_rng(k).normal(size=2 * RATE_HZ) for k in range(9))]
    yield "silence", *_count(recogniser, (Recording(each.astype(np.float32)) for each in silence))
    for kind in NOISES:
        yield kind, *_count(recogniser, (noise(kind, number) for number in range(10)))
    for language, (voice, wishes) in FOREIGN.items():
        recordings = (
            noisy(spoken(words, voice + variant), SNR_DB[0], np.random.default_rng(number))
            for variant in VARIANTS
            for number, words in enumerate(wishes)
        )
        yield language, *_count(recogniser, recordings)


def _count(recogniser: Recogniser, recordings: Iterable[Recording]) -> tuple[int, int]:
    results = [words_or_none(recogniser, recording) is not None for recording in recordings]
    return sum(results), len(results)


def _same(found: Hypothesis) -> Hypothesis:
    return found


def _is_the_same(true: str, heard: str, vocabulary: Vocabulary) -> bool:
    try:
        return understand(heard, vocabulary).text == understand(true, vocabulary).text
    except ConfigError:
        return False


def main() -> None:
    """Print two tables in Markdown."""
    parser = argparse.ArgumentParser(prog="python -m studies.spoken_wishes", description=__doc__)
    parser.add_argument("--wishes", type=int, default=len(WISHES), help="the first so many")
    count = parser.parse_args().wishes
    vocabulary = taught_vocabulary("named")
    recogniser = Recogniser(vocabulary)
    print("| voice | signal to noise | recogniser | word error rate | understood | misunderstood | refused |")
    print("|---|---|---|---|---|---|---|")
    for snr_db in SNR_DB:
        for voice in VOICES:
            listening, wish_alone, free_text = Score(), Score(), Score()
            for number, true in enumerate(WISHES[:count]):
                recording = noisy(spoken(true, voice), snr_db, np.random.default_rng(number))
                wish, free = recogniser.wish(recording), recogniser.free_text(recording)
                listening = listening.added(true, recogniser.accepted(wish, partial(_same, free)), vocabulary)
                wish_alone = wish_alone.added(true, wish.words, vocabulary)
                free_text = free_text.added(true, free.words, vocabulary)
            for name, score in (
                ("`--listen`", listening), ("taught words, never refusing", wish_alone), ("free text", free_text)
            ):  # fmt: skip
                print(f"| {voice} | {snr_db:.0f} dB | {name} | {score.cells()} |", flush=True)
    print("\n| recording | accepted |\n|---|---|")
    for name, wrong, all_of_them in accepted(recogniser):
        print(f"| {name} | {wrong} of {all_of_them} |", flush=True)


if __name__ == "__main__":
    main()
