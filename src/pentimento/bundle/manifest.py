"""The manifest of a bundle: its files, graphs, models and settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from pentimento.control.safety import SafetyEnvelope
from pentimento.control.sculpting_settings import SculptingSettings
from pentimento.planning.pushes.rollout import Unexplained
from pentimento.planning.strokes.brush import Span, StrokeTiming
from pentimento.planning.strokes.config import HandPlanConfig, PlannerConfig
from pentimento.robots.refill import Depletion

MAX_CELLS: Final = 256
"""Maximum number of cells in a pairing of the style objective; as in ``semantics.style``."""
ALIGNED_BYTES: Final = 64
"""Tensors outside their graphs begin at multiples of this in their file, with zeros between them."""


@dataclass(frozen=True)
class FileEntry:
    """A file of the bundle."""

    bytes: int
    sha256: str


@dataclass(frozen=True)
class Port:
    """An input or output of a graph."""

    name: str
    shape: tuple[int | str, ...]
    """Sizes; a name stands for a dynamic size."""
    type: Literal["float32", "int64"]
    unit: str
    """Unit, frame or range, as text."""


@dataclass(frozen=True)
class GraphEntry:
    """A graph of the bundle, and how closely it agrees with the model that it was exported from."""

    file: str
    weights: str | None
    """Name of the file beside it that holds its large tensors, maybe with those of other graphs; None where ``file``
    holds all."""
    inputs: tuple[Port, ...]
    """In order."""
    outputs: tuple[Port, ...]
    parity: dict[str, float]
    """By output: the norm of the difference from PyTorch's output over the norm of PyTorch's output; the maximum over
    several inputs."""
    tolerance: float
    """Upper bound of ``parity``."""
    models: tuple[str, ...]
    """Names of the manifest's models that it was exported from."""


@dataclass(frozen=True)
class BrushFacts:
    """A stroke model, for Bézier strokes or for paths of any shape: `Setting` says which.

    Its graphs are ``<name>_marks``, ``<name>_pull`` and, if ``has_gain``, ``<name>_gain``.
    """

    tool: str
    path_points: int
    fitted: dict[str, Span]
    timing: StrokeTiming
    depletion: Depletion | None
    """How the tool's load runs out; None where the diagnosis did not establish that it does."""
    picks_up: bool
    """Whether the tool picks up wet paint: marks have a pickup."""
    has_gain: bool
    """Whether it predicts the factor by which the camera multiplies light."""


@dataclass(frozen=True)
class WordsFacts:
    """A tokenizer."""

    vocabulary: str
    """Name of the file."""
    merges: str
    """Name of the file."""
    tokens: int
    """Length of a caption; longer ones are truncated."""


@dataclass(frozen=True)
class EncoderFacts:
    """The text-image encoder. Its graphs are ``semantic``, ``text`` and ``caption``."""

    image_px: int
    """Side of its input pictures."""
    embedding: int
    views: int
    """Number of randomly transformed views of a picture, in addition to the plain one."""
    words: WordsFacts


@dataclass(frozen=True)
class GoalFacts:
    """The goal planner. Its graphs are ``goal_text``, ``goal_encode``, ``goal_denoise`` and ``goal_decode``."""

    side_px: int
    """Side of the pictures that it was trained on."""
    latent_channels: int
    latent_step_px: int
    """Side of the square of pixels that a latent cell stands for."""
    scaling: float
    """Factor of the sampled latents."""
    alphas_cumprod: tuple[float, ...]
    final_alpha: float
    prediction: Literal["epsilon", "v_prediction", "sample"]
    spacing: Literal["trailing", "leading"]
    offset: int
    steps: int
    image_guidance: float
    text_guidance: float
    words: WordsFacts
    nouns: str | None
    """Name of the file with the nouns that it was taught; None for one that knows all words."""


@dataclass(frozen=True)
class StyleFacts:
    """Local features of pictures of one size. Their graphs are ``<name>_features`` and ``<name>_pull``."""

    height_px: int
    width_px: int
    cells: int


@dataclass(frozen=True)
class ClayFacts:
    """A push model: an ensemble of networks with one correction. The graphs of network k are ``<name>_<k>_after`` and
    ``<name>_<k>_pull``."""

    end_effector: str
    kind: Literal["push", "pinch"]
    window_m: tuple[float, float, float, float]
    """Area of the height maps, canvas frame."""
    shape: tuple[int, int]
    """Shape of the height maps, [H, W]."""
    longest_m: float
    """Maximum length of travel (pinch: closing) in the training data."""
    deepest_m: float
    """Maximum depth in the training data."""
    members: int
    """Networks of the ensemble."""
    correction: str | None
    """Name of the file with the correction by established causes (``planning.pushes.analytic.correction``); None where
    the diagnosis has kept none."""
    places: str | None = None
    """Name of the file with the place model (``planning.pushes.places``); None where no pellets were collected."""
    unexplained: Unexplained | None = None
    """What the model leaves of pushes; None where that was not measured."""


@dataclass(frozen=True)
class HandFacts:
    """A person's handwriting style; see ``planning.strokes.latent``."""

    file: str
    synthetic: bool
    """Whether the writer is made up."""


@dataclass(frozen=True)
class Setting:
    """A tool, a canvas, and how the tool paints there."""

    tool: str
    """Name of the tool's file."""
    brush: str
    """Name of the manifest's brush for Bézier strokes."""
    path_brush: str | None
    """Name of the one for strokes in a person's hand; None in a bundle without hands."""
    words: str
    """What a request to the goal planner says of the medium."""
    canvas_m: tuple[float, float]
    strokes: int
    replan_every: int
    """Strokes between two photographs, each of which replans the rest."""
    planner: PlannerConfig
    envelope: SafetyEnvelope


@dataclass(frozen=True)
class Manifest:
    """The content of ``manifest.json``."""

    schema: int
    opset: int
    ir_version: int
    files: dict[str, FileEntry]
    graphs: dict[str, GraphEntry]
    models: dict[str, str]
    """By name, the digest of the model's folder in the pipeline."""
    settings: dict[str, Setting]
    brushes: dict[str, BrushFacts]
    encoder: EncoderFacts
    goal: GoalFacts
    styles: dict[str, StyleFacts]
    clays: dict[str, ClayFacts]
    """Push models by the names of their graphs; each one's end-effector is in ``end_effectors/<name>.toml``."""
    sculpting: dict[str, SculptingSettings]
    """By push model, how its material is sculpted."""
    hands: dict[str, HandFacts]
    """By the writer's name."""
    hand_planner: HandPlanConfig
    """How strokes are planned in a hand, in every setting."""
