import inspect
import re
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import pytest
from ruamel.yaml import YAML

from pentimento.contracts.errors import ConfigError
from pipelines._config import entry_of, load_section
from pipelines._params import merge, overlaid, read_params, read_yaml, sections_of


@dataclass(frozen=True)
class Press:
    depth_m: float
    speeds_m_s: tuple[float, float]


@dataclass(frozen=True)
class Painting:
    strokes: int
    rate: float
    order: Literal["light", "dark"]
    photo: Path | None
    press: Press
    tools: dict[str, Press]
    stops: tuple[Press, ...]
    last: Press | None

    def __post_init__(self) -> None:
        if self.strokes < 0:
            raise ValueError(f"strokes must not be negative, but is {self.strokes}")


GOOD = """\
paint:
  strokes: 3
  rate: 1e-3
  order: light
  photo: cat.png
  press: {depth_m: 2 mm, speeds_m_s: [10 cm/s, 1]}
  tools:
    round: {depth_m: 0.001, speeds_m_s: [1, 2]}
  stops: [{depth_m: 0, speeds_m_s: [0, 0]}]
  last: null
"""


def load(folder: Path, text: str) -> Painting:
    (folder / "params.yaml").write_text(text)
    return load_section(folder / "params.yaml", "paint", Painting)


def test_a_section_becomes_its_dataclass_with_units_converted(tmp_path: Path) -> None:
    assert load(tmp_path, GOOD) == Painting(
        strokes=3,
        rate=0.001,
        order="light",
        photo=Path("cat.png"),
        press=Press(pytest.approx(0.002), (pytest.approx(0.1), 1.0)),  # type: ignore[arg-type]
        tools={"round": Press(0.001, (1.0, 2.0))},
        stops=(Press(0.0, (0.0, 0.0)),),
        last=None,
    )


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("strokes: 3", "strokes: many", r"paint\.strokes is 'many', expected a valid integer"),
        ("strokes: 3", "strokes: 3.5", r"paint\.strokes is 3\.5, expected a valid integer"),
        ("strokes: 3", "strokes: -1", r"paint: strokes must not be negative, but is -1"),
        ("strokes: 3\n", "stroks: 3\n", r"paint\.stroks is not a parameter; did you mean 'strokes'\?"),
        ("  strokes: 3\n", "", r"paint\.strokes is missing; add it \(int\)"),
        ("rate: 1e-3", "rate: .nan", r"paint\.rate is nan, expected a finite number"),
        ("rate: 1e-3", "rate: '1'", r"paint\.rate is '1', expected a valid number"),
        ("rate: 1e-3", "rate: true", r"paint\.rate is True, expected a valid number"),
        ("light", "blue", r"paint\.order is 'blue', expected 'light' or 'dark'"),
        ("2 mm", "2 deg", r"paint\.press\.depth_m: .*2 deg"),
        ("[10 cm/s, 1]", "[1]", r"paint\.press\.speeds_m_s is \[1\], expected tuple\[float, float\]"),
        ("[10 cm/s, 1]", "[x, 1]", r"paint\.press\.speeds_m_s: .*x"),
        ("{depth_m: 0.001, ", "{", r"paint\.tools\.round\.depth_m is missing"),
        (
            "[{depth_m: 0, ",
            "[{depth_m: null, ",
            r"paint\.stops\[0\]\.depth_m is empty, expected a valid number",
        ),
        ("cat.png", "2020-01-01", r"paint\.photo is datetime\.date\(2020, 1, 1\), expected pathlib\.Path"),
        ("last: null", "last: 3", r"paint\.last is 3, expected indented `key: value` lines"),
        ("last: null", "last: null\n  last: null", "line 11: found duplicate key"),
        ("paint:", "pain:", r"has no section 'paint'"),
        (GOOD, "[paint", r"is not valid YAML at line \d"),
        (GOOD, "paint", "holds 'paint' where sections are expected"),
    ],
)
def test_a_bad_entry_is_one_sentence_with_file_key_and_value(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    assert old in GOOD
    with pytest.raises(ConfigError, match=sentence) as caught:
        load(tmp_path, GOOD.replace(old, new, 1))
    assert str(tmp_path / "params.yaml") in str(caught.value)
    assert "\n" not in str(caught.value)


@dataclass(frozen=True)
class Photographs:
    pixels_per_m: float | Literal["auto"]
    margin_m: float | Literal["auto"]


@pytest.mark.parametrize(
    ("pixels_per_m", "margin_m", "expected"),
    [
        ("auto", "auto", Photographs("auto", "auto")),
        ("2000", "12 mm", Photographs(2000.0, pytest.approx(0.012))),  # type: ignore[arg-type]
        ("5 px/mm", "0.003", Photographs(pytest.approx(5000.0), 0.003)),  # type: ignore[arg-type]
    ],
)
def test_a_number_with_a_unit_may_be_a_word_instead(
    tmp_path: Path, pixels_per_m: str, margin_m: str, expected: Photographs
) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(f"strokes: {{pixels_per_m: {pixels_per_m}, margin_m: {margin_m}}}\n")
    assert load_section(path, "strokes", Photographs) == expected
    path.write_text("strokes: {pixels_per_m: auto, margin_m: true}\n")
    with pytest.raises(ConfigError, match=r"strokes\.margin_m is True, expected a valid number or 'auto'"):
        load_section(path, "strokes", Photographs)
    path.write_text("strokes: {pixels_per_m: 5 mm, margin_m: auto}\n")
    with pytest.raises(ConfigError, match=r"strokes\.pixels_per_m: .*5 mm"):
        load_section(path, "strokes", Photographs)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"absent\.yaml does not exist"):
        load_section(tmp_path / "absent.yaml", "paint", Painting)


@pytest.mark.parametrize("text", [b"# caf\xe9\npaint: 1\n", b"paint: \x07\n"], ids=["latin-1", "control character"])
def test_a_file_that_is_no_text_is_one_sentence(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "params.yaml").write_bytes(text)
    with pytest.raises(ConfigError, match=r"params\.yaml is not readable as YAML: .*save it as plain UTF-8 text\.$"):
        load_section(tmp_path / "params.yaml", "paint", Painting)


def test_an_entry_that_the_command_line_names_must_be_there() -> None:
    assert entry_of({"marker": "ink"}, "marker", "collect_strokes.world") == "ink"
    with pytest.raises(ConfigError, match=r"collect_strokes\.world has no entry 'crayon'; known are marker\. Add it"):
        entry_of({"marker": "ink"}, "crayon", "collect_strokes.world")


def test_defaults_in_code_do_not_stand_in_for_the_file(tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class Hidden:
        seed: int = 0

    (tmp_path / "params.yaml").write_text("paint: {}\n")
    with pytest.raises(ConfigError, match=r"paint\.seed is missing"):
        load_section(tmp_path / "params.yaml", "paint", Hidden)


STAGES = list(read_yaml(Path("dvc.yaml"))["stages"])
PRESETS = """\
planners:
  pen: {rounds: 6, rates: {middle_m: 1, color: 0}}
  small_pen: {preset: planners.pen, rounds: 3}
paint:
  settings:
    marker: {planner: {preset: planners.small_pen, rates: {color: 2}}}
"""
PEN = {"rounds": 3, "rates": {"middle_m": 1, "color": 2}}


def read(folder: Path, text: str) -> dict[str, Any]:
    (folder / "params.yaml").write_text(text)
    return read_params(folder / "params.yaml")


def test_preset_is_replaced_by_its_values_key_by_key(tmp_path: Path) -> None:
    assert read(tmp_path, PRESETS)["paint"]["settings"]["marker"]["planner"] == PEN
    assert sections_of("paint", read_yaml(tmp_path / "params.yaml")) == ["paint", "planners"]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "planners.small_pen",
            "planners.brush",
            r"paint\.settings\.marker\.planner\.preset is 'planners\.brush', which",
        ),
        ("planners.small_pen", "planners.pen.rounds", "names no mapping"),
        ("planners.pen,", "planners.small_pen,", "'planners.small_pen', which refers to itself"),
    ],
)
def test_preset_that_does_not_exist_is_an_error(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        read(tmp_path, PRESETS.replace(old, new))


@pytest.mark.parametrize(
    ("over", "planner"),
    [
        ({"paint": {"settings": {"marker": {"planner": {"rounds": 9}}}}}, PEN | {"rounds": 9}),
        ({"planners": {"pen": {"rounds": 9, "rates": {"middle_m": 5}}}}, PEN | {"rates": {"middle_m": 5, "color": 2}}),
        ({"paint": {"settings": {"marker": {"planner": {"preset": "planners.pen"}}}}}, PEN | {"rounds": 6}),
        ({"paint": {"settings": {"marker": {"planner": {"rates": {"middle_m": 5}}}}}},
         PEN | {"rates": {"middle_m": 5, "color": 2}}),
    ],
    ids=["key of a preset", "preset", "another preset", "nested key of a preset"],
)  # fmt: skip
def test_profile_overlays_presets_and_keys_of_presets(
    over: dict[str, Any], planner: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "params.yaml").write_text(PRESETS)
    merged = merge(read_yaml(tmp_path / "params.yaml"), over, Path("profiles/smoke.yaml"))
    YAML(typ="safe").dump(merged, tmp_path / "merged.yaml")
    assert read_params(tmp_path / "merged.yaml")["paint"]["settings"]["marker"]["planner"] == planner


@pytest.mark.parametrize("wrong", [{"round": 9}, {"rates": {"midle_m": 5}}, {"rounds": {"x": 1}}])
def test_profile_key_that_no_preset_has_is_an_error(wrong: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text(PRESETS)
    over = {"paint": {"settings": {"marker": {"planner": wrong}}}}
    with pytest.raises(ConfigError, match=r"profiles/smoke\.yaml: paint\.settings\.marker\.planner\.\w+"):
        merge(read_yaml(tmp_path / "params.yaml"), over, Path("profiles/smoke.yaml"))


def sections(profile: str, folder: Path) -> dict[str, Any]:
    """The sections of params.yaml under a profile, each as its stage understands it."""
    params = overlaid(Path(), profile)
    with (folder / "params.yaml").open("w", encoding="utf-8") as file:
        YAML(typ="safe").dump(params, file)
    return {stage: load_section(folder / "params.yaml", stage, section_type(stage)) for stage in STAGES}


def section_type(stage: str) -> Any:
    """The dataclass into which a stage reads its section."""
    module = import_module(f"pipelines.{stage}")
    file = r'(?:Path\("params.yaml"\)|arguments\.params)'
    read = re.search(rf'load_section\({file}, "{stage}", (\w+)\)', inspect.getsource(module))
    assert read is not None
    return getattr(module, read[1])


@pytest.mark.parametrize("profile", sorted(file.stem for file in Path("profiles").glob("*.yaml")))
def test_every_stage_understands_its_section_under_every_profile(
    profile: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PENTIMENTO_MEASURED", "/recordings")
    assert set(sections(profile, tmp_path)) == set(STAGES)


def test_the_full_profile_is_of_one_size_throughout(tmp_path: Path) -> None:
    """What only its last stages would refuse, after days."""
    full = sections("full", tmp_path)
    scenes, evaluated, deployed = full["build_scenes"].imported, full["evaluate_copainting"], full["deploy"]
    setting = full["synthesize_copaintings"].settings["marker"]
    sizes = {each.picture_px for each in full["synthesize_copaintings"].settings.values()}
    assert sizes == {scenes.side_px}
    side_m, pixels_per_m = setting.canvas_m[0], setting.planner.pixels_per_m
    media = [evaluated.settings["marker"].medium, evaluated.other_media["marker"]]
    assert {(medium.side_m, medium.planner.pixels_per_m) for medium in media} == {(side_m, pixels_per_m)}
    assert deployed.settings["marker"].canvas_m == setting.canvas_m
    assert deployed.settings["marker"].planner == setting.planner
    learnt = scenes.max_scenes * (1 - scenes.val_share - scenes.test_share)
    assert learnt > full["synthesize_copaintings"].scenes.train == 20000


def test_a_list_of_sections_says_which_entry_is_wrong_and_why(tmp_path: Path) -> None:
    from pipelines.gather_demonstrations import GatherDemonstrations

    source = {"path": "a.json", "format": "tablet", "session": "s", "hand": "ann", "unit_m": "1 mm", "optitrack": None}
    section = {
        "points": 16, "sources": [source, source | {"hand": "a/b"}],
        "synthetic": {"sessions": 2, "strokes": 9, "seed": 1},
        "limits": {"max_gap_samples": 5, "jump_m": "3 mm", "jump_factor": 8.0, "shortest_m": "1 mm", "longest_m": 0.6},
    }  # fmt: skip
    file = tmp_path / "params.yaml"
    YAML(typ="safe").dump({"gather_demonstrations": section}, file)
    with pytest.raises(ConfigError, match=r"sources\[1\]: hand is 'a/b'; it names files"):
        load_section(file, "gather_demonstrations", GatherDemonstrations)
    section["sources"] = [source]
    YAML(typ="safe").dump({"gather_demonstrations": section}, file)
    (read,) = load_section(file, "gather_demonstrations", GatherDemonstrations).sources
    assert (read.unit_m, read.c3d) == (1e-3, None)
