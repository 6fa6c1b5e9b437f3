"""What is made of the timings of synthesis."""

import re
from typing import Any

import pytest

from benchmarks import synthesis
from benchmarks.synthesis import FRIDA_ITERATION_S, SIDE_PX, bars, section, sized


def measured(print_s: float = 0.01, guided_s: float = 0.05, two_s: float = 0.5, cores: int = 2) -> dict[str, Any]:
    return {
        "cores": cores,
        "iteration": {"print": print_s, "guided": guided_s},
        "workers": {"one_s": 1.0, "two_s": two_s},
    }


def test_the_peer_s_iteration_is_half_of_its_400_strokes() -> None:
    assert pytest.approx(1.84) == FRIDA_ITERATION_S


def test_bars_are_met_from_their_own_edge_on() -> None:
    assert [bar.met for bar in bars(measured())] == [True, True, True]
    assert [bar.met for bar in bars(measured(print_s=FRIDA_ITERATION_S / 99))] == [False, True, True]
    assert [bar.met for bar in bars(measured(guided_s=FRIDA_ITERATION_S / 19))] == [True, False, True]
    assert [bar.met for bar in bars(measured(two_s=1 / 1.7))] == [True, True, False]


def test_two_workers_are_not_compared_on_one_core() -> None:
    last = bars(measured(two_s=1.0, cores=1))[-1]
    assert last.met is None and last.measured == "1.00 ×"


def test_paintings_an_hour_are_the_iterations_that_fit_into_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(synthesis, "ITERATIONS", 360)
    text = section(measured())
    assert "| ours, print objective | 0.0100 | 1000.0 | 184 × |" in text
    assert "| ours, guided | 0.0500 | 200.0 | 37 × |" in text
    assert "| two workers on 2 cores | 0.50 | 7200 |" in text


def test_tables_are_even_and_nothing_is_left_to_fill_in() -> None:
    text = section(measured())
    tables = re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)
    assert len(tables) == 3
    assert all(len({line.count("|") for line in table.splitlines()}) == 1 for table in tables)
    assert "{" not in text and "renderer alone" in text


def test_the_setting_is_planned_on_as_many_pixels_as_the_peer() -> None:
    assert sized(SIDE_PX).planned_px == (168, 168)
