from pathlib import Path

import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.studio.clay.world import CLAY_WORLDS, load_clay_world

VOCABULARY = {
    "springback", "volume_loss", "slope_slide", "far_field", "work_hardening", "adhesion_lift", "stiffness_drift",
    "height_offset", "tool_backlash",
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(file.stem for file in CLAY_WORLDS.glob("*.toml")))
def test_every_shipped_world_loads_with_the_whole_vocabulary(name: str) -> None:
    world = load_clay_world(name)
    assert set(vars(world.effects)) > VOCABULARY
    assert {"ball_small", "ball", "edge", "flat", "soft_pad", "gripper"} <= set(world.tools)


def test_the_table_has_no_effect_and_each_material_has_some() -> None:
    assert not any(vars(load_clay_world("clay_table").effects).values())
    for name in ("foam", "dough", "sand"):
        assert load_clay_world(name).material.name == name
        assert any(vars(load_clay_world(name).effects).values())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[effects]\nspring = 1.0", r"unknown keys \['spring'\]"),
        ("[slab]\nheight_m = 'thick'", "a finite number"),
        ("[slab]\nheight_m = 0.0", "sizes are above 0"),
        ("[scanner]\npixels = 4", "counts at least 8"),
        ("[effects]\nspringback = -1.0", "springback is below 0"),
        ("[air]\nx = 1", r"unknown keys \['air'\]"),
        ("[tools.ball]\nshank = 2.0", "missing keys"),
    ],
)
def test_bad_worlds_are_named(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "world.toml"
    (tmp_path / "clay_table.toml").write_text((CLAY_WORLDS / "clay_table.toml").read_text())
    file.write_text(f'base = "clay_table.toml"\n{text}\n')
    with pytest.raises(ConfigError, match=words):
        load_clay_world(file)


def test_an_unknown_world_lists_the_known() -> None:
    with pytest.raises(ConfigError, match="dough, foam, sand"):
        load_clay_world("plasticine")
