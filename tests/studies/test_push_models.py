"""The study of push models: worlds differ, training sets are nested, the page says what was found and from how much."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from pentimento.contracts.pushes import example_table
from pentimento.dynamics.pushes.measured import load_pushes
from studies.push_models import MATERIALS, World, _some, _within, drawn_world
from studies.push_models_page import page


def test_worlds_differ_by_seed_and_are_the_same_again() -> None:
    for material in MATERIALS:
        one, again, other = drawn_world(material, 1), drawn_world(material, 1), drawn_world(material, 2)
        assert asdict(one) == asdict(again)
        assert one.material.hardness_pa != other.material.hardness_pa
        assert one.effects != other.effects
        assert one.material.name == material


def test_small_training_sets_are_parts_of_larger_ones() -> None:
    samples, _ = load_pushes(example_table(20))
    small, large = _some(samples, 5, 3), _some(samples, 12, 3)
    assert set(small) < set(large)
    inside = _within(samples)
    assert inside.any() and not inside.all()
    assert (samples.action[inside, 4] < 0.008).all()


def test_every_part_has_a_place_on_the_page(tmp_path: Path) -> None:
    scores = {"l_3d_mm2": 0.012, "l_viz": 0.003, "window_l_3d_mm2": 0.01, "chamfer_mm": 0.1, "emd_mm": 0.2}
    worse = {name: 2 * value for name, value in scores.items()}
    held_out = {"model": scores, "mean_footprint": worse, "unchanged": worse}
    repeats = {"model": scores, "floor": {"l_3d_mm2": 0.01, "window_l_3d_mm2": 0.01}}
    single = {"held_out": held_out, "held_out_repeats": repeats}
    square = {on: {name: 0.01 if on == name else 0.05 for name in MATERIALS} for on in MATERIALS}
    world: dict[str, object] = {}
    for name in World(tmp_path, 1).parts():
        kind = name.split("_")[0]
        world[name] = {
            "collect": {"rows": 400},
            "both": single,
            "3d": {"held_out": held_out | {"model": worse}, "held_out_repeats": repeats},
            "transfer": square,
            "conditioned": dict.fromkeys(MATERIALS, 0.011),
            "longer": dict.fromkeys(MATERIALS, 0.0115),
            "unseen": {"adapted": 0.02, "alone": 0.04, "unadapted": 0.06},
            "size": scores,
            "outside": {"within": 0.01, "beyond": 0.03, "beyond_by_all": 0.015},
        }[kind]
    said = page([world, world])
    assert "2 of 20" in said
    assert "| foam | 2 | 0.0120 | 0.0100 | 1.20 | ≤ 1.5 (met) | 1.00 |" in said
    assert "lower on 3 of 3 materials" in said
    assert "| foam | 2 | 0.0500 | 0.0600 | 0.0400 | 0.0200 | 0.40 (met) | 0.0100 |" in said
    assert "| foam | 0.0100 | 0.0115 | 0.0110 | 1.10 | 0.96 |" in said
    assert said.count("\n## ") == 8
    assert not np.any(["nan" in line for line in said.splitlines()])
    assert "## Held-out" in page([{"both_foam": single}])
