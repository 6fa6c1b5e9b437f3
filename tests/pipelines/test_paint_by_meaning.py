"""The stage paint_by_meaning, and the report's section on it."""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from pentimento.contracts import scenes
from pentimento.contracts.codec import to_plain
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import decode_png, read_image
from pentimento.contracts.tables import write_table
from pentimento.copainting.evaluation.by_meaning import SUM, MeaningSetting, alternatives, nearest_picture
from pentimento.planning.strokes.config import PRINT_ALONE, StyleConfig, TextConfig
from pentimento.report.by_meaning import meanings_section, read_meanings
from pentimento.report.html import Album
from pentimento.semantics.encoder import Encoder, as_images
from pipelines.paint_by_meaning import PaintByMeaning, main
from tests.copainting.painters import BRUSH, MARKER, write_encoder, write_stroke_model

TEXT = TextConfig(1.0, "a red house")
STYLE = StyleConfig(0.1, "retina", "local", None)
WORDS_AND_STYLE = replace(PRINT_ALONE, print_weight=0.0, text=TEXT, style=STYLE)
SEMANTIC = replace(PRINT_ALONE, semantic_weight=0.1)
PHOTOGRAPH = MeaningSetting(
    picture="coffee", tool="marker", world="marker", canvas_m=(0.08, 0.08), darkest=0.3, strokes=6, replan_every=3,
    planner=replace(MARKER.planner, pixels_per_m=600, objectives=SEMANTIC),
)  # fmt: skip
WORDS = MeaningSetting(
    picture=None, tool="round_brush", world="round_brush", canvas_m=(0.12, 0.12), darkest=0.0, strokes=6,
    replan_every=3, planner=replace(BRUSH.planner, pixels_per_m=400, objectives=WORDS_AND_STYLE),
)  # fmt: skip
SECTION = PaintByMeaning(views=1, seed=0, settings={"semantic": PHOTOGRAPH, "words": WORDS})


def run(section: PaintByMeaning) -> Path:
    YAML(typ="safe").dump({"paint_by_meaning": to_plain(section)}, Path("params.yaml"))
    folders = {name: Path(name) for name in ("scenes", "models", "semantics", "judge", "out")}
    main(argparse.Namespace(tools=["marker", "round_brush"], **folders))
    return Path("out")


@pytest.fixture
def folder(stage_folder: Path) -> Path:
    write_table(Path("scenes"), scenes.example_table(6), scenes.CONTRACT, "# Card")
    for tool in ("marker", "round_brush"):
        write_stroke_model(Path(f"models/stroke_{tool}/weights"))
    write_encoder(Path("semantics"))
    write_encoder(Path("judge"))
    return stage_folder


def test_stage_paints_each_sum_and_its_terms_alone_and_the_report_shows_them(folder: Path) -> None:
    out = run(SECTION)
    metrics = json.loads((out / "metrics.json").read_text())
    assert set(metrics["semantic"]) == {SUM, "print", "semantic"}
    assert set(metrics["words"]) == {SUM, "print", "text", "style"}
    for name, kinds in metrics.items():
        for kind, found in kinds.items():
            planned, painted = (read_image(out / name / f"{kind}_{what}.png") for what in ("planned", "painted"))
            assert planned.shape == painted.shape == read_image(out / name / "target.png").shape
            terms = {"print", "semantic"} if name == "semantic" else {"print", "text", "style"}
            assert set(found["objectives"]) == terms
            assert -1 <= found["painted"]["similarity"] <= 1
    assert metrics["words"][SUM]["painted"]["rank_of_words"] >= 1
    inputs, album = read_meanings(out), Album()
    html = meanings_section(inputs, album)
    assert "“a red house” in the style of “retina”" in html and "the photograph “coffee”" in html
    assert {f"meaning_semantic_{kind}.png" for kind in ("target", SUM, "print", "semantic")} <= set(album.files)
    (out / "metrics.json").write_text("[]")
    with pytest.raises(ContractError, match="run the stage paint_by_meaning again"):
        read_meanings(out)


def test_alternatives_are_the_terms_alone() -> None:
    assert alternatives(PRINT_ALONE) == {SUM: PRINT_ALONE}
    found = alternatives(WORDS_AND_STYLE)
    assert found["print"] == PRINT_ALONE and found[SUM] == WORDS_AND_STYLE
    assert found["text"].text == TEXT and found["text"].style is None
    assert found["style"].style == STYLE and found["style"].text is None
    assert not found["text"].has_target and not found["style"].has_target


def test_words_start_from_the_picture_that_the_encoder_finds_nearest(folder: Path) -> None:
    rows, encoder = scenes.example_table(6).to_pylist(), Encoder.load(Path("semantics"))
    words = encoder.embed_texts(["a red house"])[0]
    nearest = nearest_picture("a red house", rows, encoder)
    cosines = [float(encoder.embed_images(as_images([decode_png(row["image"]["bytes"])]))[0] @ words) for row in rows]
    np.testing.assert_array_equal(nearest, decode_png(rows[int(np.argmax(cosines))]["image"]["bytes"]))


def test_rejects_settings_without_a_start(folder: Path) -> None:
    with pytest.raises(ValueError, match="null needs words, with print_weight and semantic_weight 0"):
        replace(PHOTOGRAPH, picture=None)
    with pytest.raises(ValueError, match="picture is 'coffee'"):
        replace(WORDS, picture="coffee")
    unknown = replace(SECTION, settings={"semantic": replace(PHOTOGRAPH, tool="flat_brush")})
    with pytest.raises(ConfigError, match=r"paint_by_meaning\.settings\.semantic\.tool"):
        run(unknown)
    assert not Path("out").exists()
