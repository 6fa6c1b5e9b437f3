"""The report's section on handwriting styles."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import encode_png
from pentimento.report.handwriting import handwriting_section, read_handwriting
from pentimento.report.html import Album

PICTURE = encode_png(np.full((8, 8, 3), 150, np.uint8))
NAMES = ("ann", "b<o>b", "bezier", "nobody")


def write(folder: Path) -> tuple[dict[str, Path], Path, Path, Path]:
    drawings, subjects, weights, demonstrations = (
        folder / name for name in ("drawings", "subjects", "weights", "demonstrations")
    )
    executed = {"ann": [0.9, 0.1], "b<o>b": [0.3, 0.7], "bezier": [1.0, 0.0], "nobody": [0.5, 0.5]}
    taken_for: dict[str, Any] = {
        "hands": ["ann", "b<o>b"], "executed": executed, "people": {}, "diagonal": 0.8, "diagonal_min": 0.7,
        "diagonal_people": 0.99, "chance": 0.5,
    }  # fmt: skip
    drawn = {
        "error": {name: 0.02 for name in NAMES} | {"blank": 0.09},
        "strokes": dict.fromkeys(NAMES, 40),
        "ink_length_m": dict.fromkeys(NAMES, 2.5),
        "taken_for": taken_for,
    }
    errors = {"fine_tuned": 0.4, "pretrained": 0.6, "nearest_demonstration": 1.2, "mean_stroke": 3.0}
    near = {"nearest_of_same_hand": 0.97, "nearest_of_same_hand_by_coordinates": 0.9, "chance": 0.5}
    for name in NAMES:
        (drawings / name).mkdir(parents=True)
        (drawings / name / "drawing.png").write_bytes(PICTURE)
    (drawings / "target.png").write_bytes(PICTURE)
    (drawings / "metrics.json").write_text(json.dumps(drawn))
    drawn_subjects = {
        "subjects": ["cat", "sun"],
        "named": {"ann": ["cat", "egg"], "b<o>b": ["cat", "sun"], "bezier": ["dog", "sun"], "target": ["cat", "sun"]},
        "named_right": {"ann": 0.5, "b<o>b": 1.0, "bezier": 0.5},
        "subjects_named_right": 0.75, "targets_named_right": 0.62, "own_strokes": 0.97, "own_drawings": 1.0,
        "hands": ["ann", "b<o>b"],
        "chance": {"subject": 1 / 245, "hand": 0.5},
    }  # fmt: skip
    (subjects / "marker").mkdir(parents=True)
    (subjects / "marker/contact_sheet.png").write_bytes(PICTURE)
    (subjects / "metrics.json").write_text(json.dumps({"marker": drawn_subjects}))
    weights.mkdir()
    (weights / "metrics.json").write_text(json.dumps({"ann": errors, "b<o>b": errors, "map": near}))
    (weights / "latent_map.png").write_bytes(PICTURE)
    demonstrations.mkdir()
    (demonstrations / "strokes.png").write_bytes(PICTURE)
    return {"portrait": drawings}, subjects, weights, demonstrations


def test_section_has_all_drawings_and_the_confusion_matrix(tmp_path: Path) -> None:
    album = Album()
    html = handwriting_section(read_handwriting(*write(tmp_path)), album)
    assert {
        f"hands_{name}.png"
        for name in (
            "portrait_target",
            "portrait_ann",
            "portrait_b<o>b",
            "portrait_bezier",
            "latent_map",
            "subjects_marker",
        )
    } <= set(album.files)
    assert "b<o>b" not in html
    for text in (
        "<b>90\u00a0%</b>",
        "averages 80\u00a0%",
        "chance 50\u00a0%",
        "Bézier strokes",
        "blank sheet 0.0900",
        "random latents",
        "among 245 classes",
        "right for 75\u00a0%",
        "<b>cat</b>",
        ">egg<",
    ):
        assert text in html


def test_missing_drawing_is_an_error(tmp_path: Path) -> None:
    folders = write(tmp_path)
    (folders[0]["portrait"] / "ann/drawing.png").unlink()
    with pytest.raises(ContractError, match="run the stages"):
        read_handwriting(*folders)
