"""The study of push models: worlds differ, training sets are nested, the page says what was found and from how much."""

from dataclasses import asdict
from pathlib import Path

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
            "plough": {"held_out": worse, "fitted": {}},
            "unet": {"held_out": worse},
            "3d": {"held_out": held_out | {"model": worse}, "held_out_repeats": repeats},
            "transfer": square,
            "conditioned": dict.fromkeys(MATERIALS, 0.011),
            "longer": dict.fromkeys(MATERIALS, 0.0115),
            "unseen": {"adapted": 0.02, "alone": 0.04, "unadapted": 0.06},
            "size": scores,
            "outside": {"within": 0.01, "beyond": 0.03, "beyond_by_all": 0.015},
        }[kind]
    said = page([world, world])
    assert "Simulated worlds: 2." in said
    assert "| foam | analytic plough | 2 | 0.0240 ± 0.0000 | 0.00600 ± 0.00000 | 0.500 ± 0.000 |" in said
    assert "| foam | 2 | 0.0120 ± 0.0000 | 0.0100 ± 0.0000 | 1.20 ± 0.00 | ≤ 1.2 (**met**) |" in said
    assert "| sand | 2 | 0.0120 ± 0.0000 | 0.0100 ± 0.0000 | 1.20 ± 0.00 | ≤ 1.15 (not met) |" in said
    assert "| foam | 2 | 0.500 ± 0.000 | < 1 (**met**) | 0.500 ± 0.000 | lower |" in said
    assert "0.40 ± 0.00 | ≤ 0.5 (**met**) | 0.0100 ± 0.0000 |" in said
    assert "| 1.100 ± 0.000 | ≤ 1.02 (not met) | 2 | 0.957 ± 0.000 |" in said
    assert said.count("\n## ") == 9
    assert "nan" not in said


def test_rows_need_not_have_the_same_worlds() -> None:
    """Foam's paired ratios over worlds are 0.5 and 0.7: 0.6 ± t(0.975, 1) 0.1."""

    def world(model: float, unet: float) -> dict[str, object]:
        scores = dict.fromkeys(("l_3d_mm2", "l_viz", "window_l_3d_mm2"))
        both = {name: dict.fromkeys(scores, model) for name in ("model", "mean_footprint", "unchanged")}
        return {"both_foam": {"held_out": both}, "unet_foam": {"held_out": dict.fromkeys(scores, unet)}}

    only = {"both_foam": world(0.3, 1.0)["both_foam"]}
    said = page([world(0.1, 0.2), world(0.21, 0.3), only])
    rows = {line.split(" | ")[1]: line.split(" | ") for line in said.splitlines() if line.startswith("| foam |")}
    assert rows["param2deform"][2] == "3"
    assert rows["U-Net without the warp"][2] == "2"
    assert rows["U-Net without the warp"][5] == "0.600 ± 1.271"
    alone = page([only])
    assert "| foam | param2deform | 1 | 0.3000 | 0.30000 | – | 0.3000 |" in alone
    assert "nan" not in alone
