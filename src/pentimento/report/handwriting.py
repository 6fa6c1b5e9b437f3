"""The report's section on handwriting styles: drawings, classification of their writers, latent space."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from pentimento.contracts.errors import ContractError
from pentimento.report.html import Album, bar
from pentimento.report.templates import render
from pentimento.report.wording import decimal, percent, tool_name

_BEZIER, _NOBODY = "bezier", "nobody"


@dataclass(frozen=True, eq=False)
class DrawnInHands:
    """The output of the stage draw_in_hands for one setting."""

    setting: str
    metrics: dict[str, Any]
    target: bytes
    """PNG, as all pictures."""
    drawings: dict[str, bytes]
    """By writer, and of Bézier strokes."""

    @property
    def hands(self) -> list[str]:
        """In the order of the confusion matrix."""
        return list(self.metrics["taken_for"]["hands"])


@dataclass(frozen=True, eq=False)
class SubjectsInHands:
    """The output of the stage draw_subjects_in_hands for one setting."""

    setting: str
    metrics: dict[str, Any]
    sheet: bytes
    """PNG."""


@dataclass(frozen=True, eq=False)
class HandwritingInputs:
    """The outputs of the stages train_trajvae, draw_in_hands and draw_subjects_in_hands."""

    drawn: list[DrawnInHands]
    subjects: list[SubjectsInHands]
    learned: dict[str, Any]
    """metrics.json of TrajVAE."""
    strokes: bytes
    """Demonstrations."""
    latent_map: bytes


def read_handwriting(
    drawings: Mapping[str, Path], subjects: Path, weights: Path, demonstrations: Path
) -> HandwritingInputs:
    """Read the folders of drawings by setting, of drawn subjects, of TrajVAE's weights and of the demonstrations.

    Raises:
        ContractError: metrics or a picture are missing.
    """
    try:
        return HandwritingInputs(
            drawn=[_read_drawn(setting, folder) for setting, folder in drawings.items()],
            subjects=[
                SubjectsInHands(name, metrics, (subjects / name / "contact_sheet.png").read_bytes())
                for name, metrics in json.loads((subjects / "metrics.json").read_text(encoding="utf-8")).items()
            ],
            learned=json.loads((weights / "metrics.json").read_text(encoding="utf-8")),
            strokes=(demonstrations / "strokes.png").read_bytes(),
            latent_map=(weights / "latent_map.png").read_bytes(),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        folders = ", ".join(map(str, (*drawings.values(), subjects, weights, demonstrations)))
        raise ContractError(
            f"The folders {folders} hold no drawings in handwriting styles ({error}); run the stages "
            "gather_demonstrations, train_trajvae, draw_in_hands and draw_subjects_in_hands."
        ) from error


def _read_drawn(setting: str, folder: Path) -> DrawnInHands:
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    names = [*metrics["taken_for"]["hands"], _BEZIER]
    pictures = {name: (folder / name / "drawing.png").read_bytes() for name in names}
    return DrawnInHands(setting, metrics, (folder / "target.png").read_bytes(), pictures)


def handwriting_section(inputs: HandwritingInputs, album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    return render(
        "report/handwriting.html",
        album=album,
        inputs=inputs,
        bezier=_BEZIER,
        settings=[
            {
                "drawn": drawn,
                "pictures": [("target", drawn.target), *drawn.drawings.items()],
                "confusion_head": ["", *(f"classified as “{hand}”" for hand in drawn.hands)],
                "confusion_rows": _confusion_rows(drawn),
            }
            for drawn in inputs.drawn
        ],
        subjects=[(one, tool_name(one.setting), _subject_rows(one)) for one in inputs.subjects],
        error_rows=[[hand, *_reconstruction_errors(inputs.learned[hand])] for hand in inputs.drawn[0].hands],
    )


def _confusion_rows(drawn: DrawnInHands) -> list[list[str]]:
    executed = drawn.metrics["taken_for"]["executed"]

    def row(title: str, shares: list[float], own: int | None) -> list[str]:
        cells = [Markup(f"<b>{percent(s)}</b>{bar(s)}") if k == own else percent(s) for k, s in enumerate(shares)]
        return [title, *cells]

    return [
        *(row(f"drawn as “{hand}”", executed[hand], k) for k, hand in enumerate(drawn.hands)),
        row("drawn with Bézier strokes", executed[_BEZIER], None),
        row("drawn from random latents", executed[_NOBODY], None),
    ]


def _subject_rows(one: SubjectsInHands) -> list[list[str]]:
    """What the judge saw in each drawing; bold where it is what was drawn."""
    found, titles = one.metrics, {"target": "target", _BEZIER: "Bézier strokes"}
    kinds = ["target", *found["hands"], _BEZIER]
    return [
        [
            titles.get(kind, f"drawn as “{kind}”"),
            *(
                Markup("<b>{}</b>").format(seen) if seen == name else seen
                for name, seen in zip(found["subjects"], found["named"][kind], strict=True)
            ),
        ]
        for kind in kinds
    ]


def _reconstruction_errors(errors: dict[str, float]) -> list[str]:
    return [decimal(errors[name]) for name in ("fine_tuned", "pretrained", "nearest_demonstration", "mean_stroke")]
