"""What goal planners are asked for in an evaluation: named things, or the held-out scenes of a table."""

from __future__ import annotations

from dataclasses import dataclass

import pyarrow as pa

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.copainting.drawings.pairs import drawn_pairs
from pentimento.copainting.drawings.scenes import Medium as DrawingMedium
from pentimento.copainting.drawings.sources import nouns_of
from pentimento.copainting.evaluation.cases import Case, begun_by_others, choose_cases, composed_cases, paper_cases
from pentimento.copainting.evaluation.codraw import Codrawing, Story, stories, wishes
from pentimento.copainting.scenes.collage import shows_named_things
from pentimento.copainting.scenes.edits import Pair, scene_edits, scenes_of
from pentimento.deploy.words import taught_vocabulary

BEGUN = "begun"
"""Requests on canvases that somebody else began: the thesis's Table 6.1."""

_TURNS = 3  # of a story whose things a person begins to draw
_BLANK_SHARE = 0.3  # of the windows to be completed


@dataclass(frozen=True, eq=False)
class Exam:
    """Held-out requests."""

    on_canvas: dict[str, list[Case]]
    """By kind; `BEGUN` is one of them."""
    on_paper: dict[str, list[Case]]
    """By kind."""
    edits: list[Pair]
    """Pictures with one thing missing."""
    stories: list[Story]
    kinds: tuple[str, ...]
    """Which the judge ranks."""
    vocabulary: Vocabulary | None
    """What the planners were taught; None if they know all words."""


@dataclass(frozen=True)
class ExamSize:
    """How many requests of each kind."""

    prompts: int
    """On begun canvases (thesis 6.6.1)."""
    blank_canvas_prompts: int
    """On blank paper."""
    ordinary_scenes: int
    """Held-out scenes with an object removed."""


def exam_from(table: pa.Table, size: ExamSize, codrawing: Codrawing, *, has_ink: bool, seed: int) -> Exam:
    """The requests for a checked `scenes` table, drawn as the robot draws them.

    Args:
        has_ink: the robot draws with a pen, so that named things are pen drawings.
    """
    held_out = scenes_of(table, "test")
    paper = paper_cases(held_out, size.blank_canvas_prompts)
    if not shows_named_things(table):
        begun = choose_cases(held_out, scenes_of(table, "train"), size.prompts, seed)
        edits = scene_edits(held_out.slice(0, size.ordinary_scenes), 1, seed)
        told = stories(held_out, codrawing.stories, _TURNS)
        return Exam({BEGUN: begun}, {"on_paper": paper}, edits, told, _kinds(held_out), None)
    side, nouns, vocabulary = paper[0].image.shape[0], nouns_of("openmoji"), taught_vocabulary("named")
    medium: DrawingMedium = "marker" if has_ink else "colour"
    on_canvas = {
        name: begun_by_others(size.prompts, medium, side_px=side, overlapping=over, seed=seed)
        for name, over in ((BEGUN, False), ("overlapping", True))
    }
    composed = {
        f"composed_{name}": composed_cases(
            size.blank_canvas_prompts, split, medium, vocabulary=vocabulary, side_px=side, seed=seed
        )
        for name, split in (("seen", "train"), ("held_out", "test"))
    }
    edits = drawn_pairs(size.ordinary_scenes, "test", nouns, blank_share=_BLANK_SHARE, side_px=side, seed=seed)
    told = wishes(codrawing.stories, turns=codrawing.wishes, side_px=side, seed=seed)
    return Exam(on_canvas, {"on_paper": paper, **composed}, edits, told, nouns, vocabulary)


def _kinds(table: pa.Table) -> tuple[str, ...]:
    """All kinds of objects that scenes name; empty where they name none."""
    if "objects" not in table.column_names:
        return ()
    return tuple(sorted({str(kind) for kinds in table["objects"].to_pylist() for kind in kinds or ()}))
