"""The report's section on handwriting styles: drawings, classification of their writers, latent space."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from pentimento.contracts.errors import ContractError
from pentimento.report.html import Album, bar
from pentimento.report.templates import render
from pentimento.report.wording import decimal, percent

_BEZIER, _NOBODY = "bezier", "nobody"


@dataclass(frozen=True, eq=False)
class HandwritingInputs:
    """The outputs of the stages train_trajvae and draw_in_hands."""

    drawn: dict[str, Any]
    """metrics.json of the drawings."""
    learned: dict[str, Any]
    """metrics.json of TrajVAE."""
    target: bytes
    """PNG, as all pictures."""
    drawings: dict[str, bytes]
    """By writer, and of Bézier strokes."""
    strokes: bytes
    """Demonstrations."""
    latent_map: bytes

    @property
    def hands(self) -> list[str]:
        """In the order of the confusion matrix."""
        return list(self.drawn["taken_for"]["hands"])


def read_handwriting(drawings: Path, weights: Path, demonstrations: Path) -> HandwritingInputs:
    """Read the folders of drawings, of TrajVAE's weights and of the demonstrations.

    Raises:
        ContractError: metrics or a picture are missing.
    """
    try:
        drawn = json.loads((drawings / "metrics.json").read_text(encoding="utf-8"))
        names = [*drawn["taken_for"]["hands"], _BEZIER]
        return HandwritingInputs(
            drawn=drawn,
            learned=json.loads((weights / "metrics.json").read_text(encoding="utf-8")),
            target=(drawings / "target.png").read_bytes(),
            drawings={name: (drawings / name / "drawing.png").read_bytes() for name in names},
            strokes=(demonstrations / "strokes.png").read_bytes(),
            latent_map=(weights / "latent_map.png").read_bytes(),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ContractError(
            f"{drawings}, {weights} and {demonstrations} hold no drawings in handwriting styles ({error}); run the "
            "stages gather_demonstrations, train_trajvae and draw_in_hands."
        ) from error


def handwriting_section(inputs: HandwritingInputs, album: Album) -> Markup:
    """HTML of the section; its pictures go into the album."""
    return render(
        "report/handwriting.html",
        album=album,
        inputs=inputs,
        bezier=_BEZIER,
        diagonal_min=inputs.drawn["taken_for"]["diagonal_min"],
        pictures=[("target", inputs.target), *inputs.drawings.items()],
        confusion_head=["", *(f"classified as “{hand}”" for hand in inputs.hands)],
        confusion_rows=_confusion_rows(inputs),
        error_rows=[[hand, *_reconstruction_errors(inputs.learned[hand])] for hand in inputs.hands],
    )


def _confusion_rows(inputs: HandwritingInputs) -> list[list[str]]:
    executed = inputs.drawn["taken_for"]["executed"]

    def row(title: str, shares: list[float], own: int | None) -> list[str]:
        cells = [Markup(f"<b>{percent(s)}</b>{bar(s)}") if k == own else percent(s) for k, s in enumerate(shares)]
        return [title, *cells]

    return [
        *(row(f"drawn as “{hand}”", executed[hand], k) for k, hand in enumerate(inputs.hands)),
        row("drawn with Bézier strokes", executed[_BEZIER], None),
        row("drawn from random latents", executed[_NOBODY], None),
    ]


def _reconstruction_errors(errors: dict[str, float]) -> list[str]:
    return [decimal(errors[name]) for name in ("fine_tuned", "pretrained", "nearest_demonstration", "mean_stroke")]
