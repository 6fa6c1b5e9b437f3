"""The report's section on drawing in people's hands: the drawings, who is taken to have made them, the latent space."""

from __future__ import annotations

import json
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ContractError
from pentimento.report.html import Album, bar, row, table
from pentimento.report.wording import count, decimal, percent

_BEZIER, _NOBODY = "bezier", "nobody"


@dataclass(frozen=True, eq=False)
class HandInputs:
    """What the stages train_trajvae and draw_in_hands made."""

    drawn: dict[str, Any]
    """metrics.json of the drawings."""
    learned: dict[str, Any]
    """metrics.json of TrajVAE."""
    target: bytes
    """PNG, as all pictures."""
    drawings: dict[str, bytes]
    """By hand, and of Bézier strokes."""
    strokes: bytes
    """Demonstrations."""
    latent_map: bytes

    @property
    def hands(self) -> list[str]:
        """In the order of the confusion matrix."""
        return list(self.drawn["taken_for"]["hands"])


def read_hands(drawings: Path, weights: Path, demonstrations: Path) -> HandInputs:
    """Read the folders of drawings, of TrajVAE's weights and of the demonstrations.

    Raises:
        ContractError: metrics or a picture are missing.
    """
    try:
        drawn = json.loads((drawings / "metrics.json").read_text(encoding="utf-8"))
        names = [*drawn["taken_for"]["hands"], _BEZIER]
        return HandInputs(
            drawn=drawn,
            learned=json.loads((weights / "metrics.json").read_text(encoding="utf-8")),
            target=(drawings / "target.png").read_bytes(),
            drawings={name: (drawings / name / "drawing.png").read_bytes() for name in names},
            strokes=(demonstrations / "strokes.png").read_bytes(),
            latent_map=(weights / "latent_map.png").read_bytes(),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ContractError(
            f"{drawings}, {weights} and {demonstrations} hold no drawings in hands ({error}); run the stages "
            "gather_demonstrations, train_trajvae and draw_in_hands."
        ) from error


def hands_section(inputs: HandInputs, album: Album) -> str:
    """HTML of the section; its pictures go into the album."""
    error = inputs.drawn["error"]
    figures = [album.photo("hands_target.png", inputs.target, "What was to be drawn.", "<b>To be drawn</b>.")]
    for name, picture in inputs.drawings.items():
        title = "Bézier strokes" if name == _BEZIER else f"The hand “{escape(name)}”"
        caption = (
            f"<b>{title}</b>: {count(inputs.drawn['strokes'][name], 'stroke')}, {decimal(inputs.drawn['ink_m'][name])} "
            f"m of line; error {decimal(error[name])} (blank sheet {decimal(error['blank'])})."
        )
        figures.append(album.photo(f"hands_{name}.png", picture, f"The drawing: {name}.", caption))
    rows = "".join(row(figures[start : start + 4]) for start in range(0, len(figures), 4))
    demonstrations = album.plot(
        "hands_demonstrations.png", inputs.strokes, "Strokes of each hand.",
        "Demonstrations, two rows a hand, in the standard frame: from the left end to the right.",
    )  # fmt: skip
    return f"""<section id="hands">
<h2>Drawing in a person’s hand</h2>
<p>From a few strokes of a person the robot learns how that hand moves: an autoencoder turns each stroke into a point of
a latent space, and back. A drawing is then planned with points of that space in place of curves, so that the same
photograph comes out in one hand or another. A hand is a file; another one is loaded without training.</p>
{demonstrations}
{rows}
{_taken_for(inputs)}
{_learned(inputs)}
{_map(inputs, album)}
</section>"""


def _taken_for(inputs: HandInputs) -> str:
    told, hands = inputs.drawn["taken_for"], inputs.hands

    def line(title: str, shares: list[float], own: int | None) -> list[str]:
        cells = [f"<b>{percent(s)}</b>{bar(s)}" if k == own else percent(s) for k, s in enumerate(shares)]
        return [title, *cells]

    rows = [line(f"drawn in “{escape(hand)}”", told["executed"][hand], k) for k, hand in enumerate(hands)]
    rows.append(line("drawn with Bézier strokes", told["executed"][_BEZIER], None))
    rows.append(line("drawn by latents of nobody", told["executed"][_NOBODY], None))
    caption = (
        "Whose hand each executed stroke is taken for, by a classifier that has learned from demonstrations only and "
        f"looks at the path that the robot measured. On the diagonal {percent(told['diagonal'])} on average, "
        f"{percent(told['diagonal_min'])} at least; chance is {percent(told['chance'])}, and people’s own strokes of "
        f"a session that it has not seen reach {percent(told['diagonal_people'])}."
    )
    return table(("", *(f"taken for “{escape(hand)}”" for hand in hands)), rows, caption)


def _learned(inputs: HandInputs) -> str:
    rows = []
    for hand in inputs.hands:
        errors = inputs.learned[hand]
        names = ("fine_tuned", "pretrained", "nearest_demonstration", "mean_stroke")
        rows.append([escape(hand), *(decimal(errors[name]) for name in names)])
    caption = (
        "Mean distance in mm between strokes of a session that was not learned from and what the model makes of them: "
        "after and before it was fine-tuned on the session’s first strokes, and if the nearest or the mean of those "
        "is taken."
    )
    return table(("hand", "fine-tuned", "pretrained", "nearest", "mean"), rows, caption)


def _map(inputs: HandInputs, album: Album) -> str:
    told = inputs.learned["map"]
    own, plain = told["nearest_of_same_hand"], told["nearest_of_same_hand_by_coordinates"]
    return album.plot(
        "hands_latent_map.png", inputs.latent_map, "Map of the latent space.",
        "The latent space, laid flat by t-SNE, each stroke drawn where it lies, a colour a hand. The nearest "
        f"neighbour of a stroke is of its own hand in {percent(own)} of the cases (by plain coordinates "
        f"{percent(plain)}, by chance {percent(told['chance'])}).",
    )  # fmt: skip
