"""World files are read whole or not at all."""

from pathlib import Path

import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.studio.strokes.world import WORLDS, load_world

NAMES = sorted(path.stem for path in WORLDS.glob("*.toml") if path.stem != "table")
VOCABULARY = {
    *("ink_depletion", "speed_width", "speed_density", "speed_bleed", "bristle_lag", "latency", "backlash"),
    *("path_scale", "path_offset", "canvas_tilt", "lens_distortion", "vignetting", "illumination_gradient"),
    *("tool_wear", "drying_shift", "wet_mixing", "orientation_width", "curvature_width", "paper_bleed"),
}


@pytest.mark.parametrize("name", NAMES)
def test_shipped_worlds_have_a_strength_for_every_cause(name: str) -> None:
    assert set(vars(load_world(name).effects)) == VOCABULARY


def test_plain_world_has_no_effect() -> None:
    assert not any(vars(load_world("plain").effects).values())


def _write(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_overrides_its_base_key_by_key(tmp_path: Path) -> None:
    base = WORLDS / "plain.toml"
    world = load_world(_write(tmp_path, f'base = "{base}"\n[effects]\nlatency = 1\n'))
    assert world.effects.latency == 1.0
    assert world.tool == load_world("plain").tool


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[effects]\nlattency = 1.0\n", r"unknown keys \['lattency'\]"),
        ("[clay]\nyield = 1.0\n", r"unknown keys \['clay'\]"),
        ('[robot]\nlatency_s = "fast"\n', "robot.latency_s is 'fast'"),
        ("[paper]\nsize_m = [0.3]\n", "paper.size_m is .* a list of 2"),
        ('[tool]\nkind = "spoon"\n', "tool.kind is 'spoon'; it must be one of"),
        ("seed = 3\n", "'seed' outside a section"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_world(_write(tmp_path, f'base = "{WORLDS / "plain.toml"}"\n{text}'))


def test_missing_sections_and_files_and_circles_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="missing keys"):
        load_world(_write(tmp_path, "[effects]\n"))
    with pytest.raises(ConfigError, match="round_brush"):
        load_world("round_brsh")
    with pytest.raises(ConfigError, match="its own base"):
        load_world(_write(tmp_path, 'base = "mine.toml"\n'))
    with pytest.raises(ConfigError, match="not valid TOML"):
        load_world(_write(tmp_path, "[effects\n"))
