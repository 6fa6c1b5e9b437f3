"""How well it is heard how a wish is said: `python -m studies.spoken_manner`, some minutes of one core.

espeak-ng speaks wishes faster and slower, higher and lower, flatter and livelier, louder and softer; pink noise is
added at two levels. First one setting at a time is changed: printed is the rank correlation of what is measured with
what was set. Then three manners are spoken, calm, ordinary and excited: printed is how often two different wishes in
two manners are in the right order of arousal. The baseline knows nothing but the duration of the speech.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from pentimento.sound.affect import affect_of
from pentimento.sound.manner import Manner, is_speech, manner_of, speaking_s, speech_levels
from pentimento.sound.recording import RATE_HZ, Recording, read_recording
from studies.spoken_wishes import SNR_DB, VOICES, WISHES, noisy

Samples = NDArray[np.float32]


@dataclass(frozen=True)
class Setting:
    """Of espeak-ng."""

    words_per_minute: int = 150
    pitch: int = 50
    """0 to 99."""
    range: str = "medium"
    """Of the pitch, as SSML has it."""
    amplitude: int = 100
    """In per cent of the usual one."""


ORDINARY: Final = Setting()
RATES: Final = (110, 150, 210)
PITCHES: Final = (20, 50, 80)
RANGES: Final = ("x-low", "medium", "x-high")
AMPLITUDES: Final = (50, 70, 100)
"""Above 100, espeak-ng's samples are cut."""
MANNERS: Final = {
    "calm": Setting(110, range="x-low", amplitude=50), "ordinary": ORDINARY, "excited": Setting(210, range="x-high"),
}  # fmt: skip


@cache
def said(words: str, voice: str, setting: Setting) -> Samples:
    """Samples of espeak-ng's speech, with .4 s of silence around it."""
    text = f'<speak><prosody range="{setting.range}">{words}</prosody></speak>'
    options = {"-v": voice, "-s": setting.words_per_minute, "-p": setting.pitch, "-a": setting.amplitude}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "speech.wav"
        command = ["espeak-ng", "-m", "-w", str(file), *(str(part) for pair in options.items() for part in pair), text]
        subprocess.run(command, check=True)
        return np.pad(read_recording(file).samples, round(0.4 * RATE_HZ))


def recorded(words: str, voice: str, setting: Setting, *, snr_db: float, seed: int) -> Recording:
    """The speech in noise that is `snr_db` below the ordinary voice, however loud this one is."""
    samples = said(words, voice, setting)
    relative_db = level_db(samples) - level_db(said(words, voice, ORDINARY))
    return noisy(samples, snr_db + relative_db, np.random.default_rng(seed))


def level_db(samples: Samples) -> float:
    """Mean power without the pauses."""
    return float(10 * np.log10(np.square(samples[np.abs(samples) > 0.1 * np.abs(samples).max()]).mean()))


def brevity(recording: Recording) -> float:
    """The baseline: the shorter, the more excited and the faster."""
    return -speaking_s(is_speech(speech_levels(recording)))


def rank_correlation(levels: Sequence[int], values: Sequence[float]) -> float:
    """Spearman's, over what could be measured."""
    known = np.isfinite(values)
    return float(spearmanr(np.array(levels)[known], np.array(values)[known]).statistic)


def correlations(wishes: Sequence[str], snr_db: float) -> Iterator[tuple[str, str, list[float], float, float]]:
    """Of each setting that is changed alone: its name, the measure's, the rank correlation with each voice, that of the
    baseline, and the share of recordings in which nothing was measured."""
    cases: tuple[tuple[str, str, list[Setting], Callable[[Manner], float]], ...] = (
        ("words a minute", "pace", [Setting(words_per_minute=rate) for rate in RATES], lambda m: m.pace_hz),
        ("pitch", "pitch", [Setting(pitch=pitch) for pitch in PITCHES], lambda m: m.pitch_hz),
        ("pitch range", "pitch range", [Setting(range=size) for size in RANGES], lambda m: m.pitch_range_st),
        ("amplitude", "loudness", [Setting(amplitude=each) for each in AMPLITUDES], lambda m: m.loudness_db),
    )
    for name, measure, settings, value_of in cases:
        found, short, missing = [], [], []
        for voice in VOICES:
            levels, values, durations = [], [], []
            for number, words in enumerate(wishes):
                for level, setting in enumerate(settings):
                    recording = recorded(words, voice, setting, snr_db=snr_db, seed=number)
                    levels.append(level)
                    values.append(value_of(manner_of(recording, words)))
                    durations.append(brevity(recording))
            found.append(rank_correlation(levels, values))
            short.append(rank_correlation(levels, durations))
            missing.append(float(np.mean(np.isnan(values))))
        yield name, measure, found, float(np.mean(short)), float(np.mean(missing))


def in_order(below: Sequence[float], above: Sequence[float]) -> float:
    """Share of the pairs of different wishes in which the second is larger; equal ones count as half."""
    pairs = [(a, b) for (i, a), (k, b) in product(enumerate(below), enumerate(above)) if i != k]
    return float(np.mean([0.5 + 0.5 * np.sign(b - a) for a, b in pairs]))


def main() -> None:
    """Print two tables in Markdown."""
    parser = argparse.ArgumentParser(prog="python -m studies.spoken_manner", description=__doc__)
    parser.add_argument("--wishes", type=int, default=len(WISHES), help="the first so many")
    wishes = WISHES[: parser.parse_args().wishes]
    print(f"| set | measured | signal to noise | {' | '.join(VOICES)} | duration alone | not measured |")
    print(f"|---|---|---|{'---|' * len(VOICES)}---|---|")
    for snr_db in SNR_DB:
        for name, measure, found, short, missing in correlations(wishes, snr_db):
            cells = " | ".join(f"{value:.2f}" for value in found)
            print(f"| {name} | {measure} | {snr_db:.0f} dB | {cells} | {short:.2f} | {missing:.0%} |", flush=True)
    titles = ("order of arousal right", "duration alone", "calm below 0", "ordinary at 0", "excited above 0")
    print(f"\n| voice | signal to noise | {' | '.join(titles)} |")
    print("|---|---|---|---|---|---|---|")
    for snr_db, voice in product(SNR_DB, VOICES):
        arousals: dict[str, list[float]] = {}
        durations: dict[str, list[float]] = {}
        for name, setting in MANNERS.items():
            recordings = [recorded(words, voice, setting, snr_db=snr_db, seed=k) for k, words in enumerate(wishes)]
            arousals[name] = [
                affect_of(manner_of(recording, words)).arousal
                for recording, words in zip(recordings, wishes, strict=True)
            ]
            durations[name] = [brevity(recording) for recording in recordings]
        pairs = (("calm", "ordinary"), ("ordinary", "excited"), ("calm", "excited"))
        right, short = (
            float(np.mean([in_order(values[one], values[other]) for one, other in pairs]))
            for values in (arousals, durations)
        )
        shares = (
            np.mean([value < 0 for value in arousals["calm"]]), np.mean([value == 0 for value in arousals["ordinary"]]),
            np.mean([value > 0 for value in arousals["excited"]]),
        )  # fmt: skip
        cells = " | ".join(f"{share:.0%}" for share in (right, short, *shares))
        print(f"| {voice} | {snr_db:.0f} dB | {cells} |", flush=True)
    print(f"\nHighest possible rank correlation with three levels: {math.sqrt(8 / 9):.2f}.")


if __name__ == "__main__":
    main()
