"""Settings of the stroke planner, each with its unit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.planning.strokes.palette import PaletteChoice

Log = Callable[[str, float, int], None]
"""``log(name, value, step)``."""


def no_log(_name: str, _value: float, _step: int) -> None:
    """A `Log` that discards its values."""


@dataclass(frozen=True)
class LearningRates:
    """Adam's largest step for each parameter of a Bézier stroke. A schedule scales all by one factor."""

    middle_m: float
    theta_rad: float
    length_m: float
    bend_m: float
    press_m: float
    color: float
    """Linear light: of a stroke's colour where it is free, of a paint's where strokes share it."""

    def __post_init__(self) -> None:
        at_least(self, 0, "middle_m", "theta_rad", "length_m", "bend_m", "press_m", "color")

    def steps(self) -> tuple[float, ...]:
        """In the order of ``Strokes.arrays``."""
        return (self.middle_m, self.theta_rad, self.length_m, self.bend_m, self.press_m, self.color)


@dataclass(frozen=True)
class ShapeRates:
    """Adam's largest step for each parameter of a shaped stroke. A schedule scales all by one factor."""

    middle_m: float
    theta_rad: float
    press_m: float
    shape: float
    """In standard deviations of the shapes' parameters; 0 leaves the shapes as they were sampled."""
    color: float
    """As for Bézier strokes."""

    def __post_init__(self) -> None:
        at_least(self, 0, "middle_m", "theta_rad", "press_m", "shape", "color")

    def steps(self) -> tuple[float, ...]:
        """In the order of ``ShapedStrokes.arrays``."""
        return (self.shape, self.middle_m, self.theta_rad, self.press_m, self.color)


@dataclass(frozen=True)
class ExecutionNoise:
    """Random errors of execution that a plan should tolerate, drawn for each stroke at each iteration."""

    thinning: float
    """A stroke's width shrinks by up to this share: paint runs low, the brush lags."""
    shift_m: float
    """Standard deviation of a stroke's place, along each axis."""

    def __post_init__(self) -> None:
        at_least(self, 0, "thinning", "shift_m")
        if self.thinning >= 1:
            raise ValueError(f"thinning is {self.thinning}; it must be below 1, or strokes would vanish.")

    def any(self) -> bool:
        """Whether there is any noise."""
        return self.thinning > 0 or self.shift_m > 0


@dataclass(frozen=True)
class StyleConfig:
    """The style objective."""

    weight: float
    """With a print objective of weight 1, a weight of 0.02 shows in a painting and 0.08 recolours it."""
    picture: str
    """A file, or the name of a photograph that scikit-image ships."""
    features: Literal["local", "vgg16"]
    vgg16_weights: str | None
    """File of torchvision's VGG-16 state dict, for ``features: vgg16``."""

    def __post_init__(self) -> None:
        above_zero(self, "weight")
        if (self.features == "vgg16") != (self.vgg16_weights is not None):
            raise ValueError(
                f"vgg16_weights is {self.vgg16_weights!r} while features is {self.features!r}; "
                "give the file with vgg16, and null otherwise."
            )


@dataclass(frozen=True)
class TextConfig:
    """The text objective."""

    weight: float
    """With a print objective of weight 1; see docs/objectives.md."""
    words: str
    """What the painting should show."""

    def __post_init__(self) -> None:
        above_zero(self, "weight")
        if not self.words.strip():
            raise ValueError("words is empty; say what the painting should show.")


@dataclass(frozen=True)
class ObjectivesConfig:
    """The weighted sum that a plan minimises (thesis eq. 4.5)."""

    print_weight: float
    """Of the difference from the target, pixel by pixel (eq. 4.3)."""
    semantic_weight: float
    """Of the difference from what the encoder sees in the target (eq. 4.4)."""
    text: TextConfig | None
    style: StyleConfig | None

    def __post_init__(self) -> None:
        at_least(self, 0, "print_weight", "semantic_weight")
        if not (self.print_weight or self.semantic_weight or self.text or self.style):
            raise ValueError(
                "print_weight and semantic_weight are 0, text and style are null; give at least one objective a weight."
            )

    @property
    def has_meaning(self) -> bool:
        """Whether an encoder is needed. Its objectives draw new views at each call, so their values do not compare."""
        return self.semantic_weight > 0 or self.text is not None

    @property
    def has_target(self) -> bool:
        """Whether the plan is for a target, rather than for words or a style alone."""
        return self.print_weight > 0 or self.semantic_weight > 0


PRINT_ALONE = ObjectivesConfig(print_weight=1.0, semantic_weight=0.0, text=None, style=None)


@dataclass(frozen=True)
class PlannerConfig:
    """How Bézier strokes are planned."""

    initialisation: Literal["random", "error_guided", "saliency", "lines"]
    """Where strokes start: anywhere (thesis 4.3.5), where the error is large, where error and saliency are, or along
    the target's lines and then where the error is large. `lines` is for a tool with its own ink.
    """
    candidates: int
    """Candidates rendered for each new stroke; the one that lowers the error most is kept."""
    rounds: int
    """Rounds in which strokes are added, from long and full to short and light."""
    sizes: tuple[float, float]
    """Size of the first and of the last round's strokes: 0 is the tool's shortest and lightest, 1 its longest and
    fullest. Relocated strokes start with the last round's size."""
    iterations_per_round: int
    """At half the resolution."""
    iterations_free: int
    """With free colours, after the last round."""
    iterations_palette: int
    """After the colours became paints and the strokes were ordered."""
    iterations_replan: int
    """After each photograph (thesis 4.3.5)."""
    replan_rate: float
    """Share of the learning rates that replanning uses, since it starts near the optimum."""
    relocate_every: int
    """Iterations between two relocations of useless strokes; 0 for never."""
    relocate_share: float
    """Largest share of the strokes that is relocated each time."""
    min_gain_per_stroke: float
    """Rounds stop after one whose strokes lowered the objective by less than this on average; 0 uses all rounds. Plans
    that start along lines end without the strokes that lower it by less.
    """
    palette: PaletteChoice
    sweeps: int
    """Largest number of times that the brush goes through the paints from light to dark; 1 is the thesis's order."""
    path_points: int
    """Points of a path in the stroke model."""
    pixels_per_m: float
    """Resolution of planning."""
    edge_m: float
    """Distance that strokes keep from the canvas's edge."""
    distances_px: tuple[int, ...]
    """Viewing distances of the print objective."""
    objectives: ObjectivesConfig
    execution_noise: ExecutionNoise
    learning_rates: LearningRates
    seed: int

    coarse_first: ClassVar[bool] = True
    """Whether the rounds and the first free iterations run at half the resolution."""
    keep_best: ClassVar[bool] = True
    """Whether a descent returns the parameters with the lowest objective rather than the last ones."""

    def __post_init__(self) -> None:
        at_least(self, 0, "iterations_per_round", "iterations_free", "iterations_palette", "iterations_replan")
        at_least(self, 0, "replan_rate", "relocate_every", "relocate_share", "min_gain_per_stroke", "edge_m", "seed")
        at_least(self, 1, "candidates", "rounds", "sweeps")
        at_least(self, 2, "path_points")
        if not all(0 <= size <= 1 for size in self.sizes):
            raise ValueError(f"sizes is {list(self.sizes)}; each is a share of the tool's range, from 0 to 1.")
        above_zero(self, "pixels_per_m")
        _check_shares_and_distances(self.relocate_share, self.distances_px)


@dataclass(frozen=True)
class ShapedPlanConfig:
    """How strokes of one kind of shape are planned (thesis 5.3.6)."""

    candidates: int
    """Candidates rendered at each place; the one that lowers the error most is kept."""
    rounds: int
    """Rounds in which strokes are added."""
    iterations_per_round: int
    iterations: int
    """After the last round, with free colours."""
    iterations_palette: int
    """After the colours became paints and the strokes were ordered."""
    iterations_replan: int
    """After each photograph."""
    replan_rate: float
    """Share of the learning rates that replanning uses."""
    relocate_every: int
    """Iterations between two relocations of useless strokes; 0 for never."""
    relocate_share: float
    """Largest share of the strokes that is relocated each time."""
    max_latent_distance: float
    """Largest distance of a stroke's latent from the demonstration that it started from, in standard deviations of the
    writer's latents."""
    palette: PaletteChoice
    sweeps: int
    """As for Bézier strokes."""
    path_points: int
    """N, of the demonstrations and of each path."""
    pixels_per_m: float
    edge_m: float
    """Distance that strokes keep from the canvas's edge."""
    distances_px: tuple[int, ...]
    """Viewing distances of the print objective."""
    objectives: ObjectivesConfig
    learning_rates: ShapeRates
    seed: int

    execution_noise: ClassVar[ExecutionNoise] = ExecutionNoise(0.0, 0.0)
    min_gain_per_stroke: ClassVar[None] = None
    coarse_first: ClassVar[bool] = False
    keep_best: ClassVar[bool] = False

    def __post_init__(self) -> None:
        at_least(self, 1, "candidates", "rounds", "sweeps")
        at_least(
            self,
            0,
            "iterations_per_round",
            "iterations",
            "iterations_palette",
            "iterations_replan",
            "replan_rate",
            "relocate_every",
            "relocate_share",
            "max_latent_distance",
            "edge_m",
        )
        at_least(self, 0, "seed")
        at_least(self, 2, "path_points")
        above_zero(self, "pixels_per_m")
        _check_shares_and_distances(self.relocate_share, self.distances_px)


@dataclass(frozen=True)
class HandPlanConfig:
    """How a tool's strokes are planned in a person's hand: what Bézier strokes do not have. The rest is theirs."""

    rounds: int
    """As in ``ShapedPlanConfig``."""
    max_latent_distance: float
    """As in ``ShapedPlanConfig``."""
    shape_rate: float
    """See ``ShapeRates.shape``."""

    def __post_init__(self) -> None:
        at_least(self, 1, "rounds")
        at_least(self, 0, "max_latent_distance", "shape_rate")

    def of(self, planner: PlannerConfig, points: int) -> ShapedPlanConfig:
        """The settings for shapes of so many points, where the tool's Bézier strokes are planned by ``planner``."""
        rates = planner.learning_rates
        return ShapedPlanConfig(
            candidates=planner.candidates,
            rounds=self.rounds,
            iterations_per_round=planner.iterations_per_round,
            iterations=planner.iterations_free,
            iterations_palette=planner.iterations_palette,
            iterations_replan=planner.iterations_replan,
            replan_rate=planner.replan_rate,
            relocate_every=planner.relocate_every,
            relocate_share=planner.relocate_share,
            max_latent_distance=self.max_latent_distance,
            palette=planner.palette,
            sweeps=planner.sweeps,
            path_points=points,
            pixels_per_m=planner.pixels_per_m,
            edge_m=planner.edge_m,
            distances_px=planner.distances_px,
            objectives=planner.objectives,
            learning_rates=ShapeRates(
                rates.middle_m, rates.theta_rad, rates.press_m, shape=self.shape_rate, color=rates.color
            ),
            seed=planner.seed,
        )


PlanConfig = PlannerConfig | ShapedPlanConfig
"""What the shared planner reads."""


def _check_shares_and_distances(relocate_share: float, distances_px: tuple[int, ...]) -> None:
    if relocate_share > 1:
        raise ValueError(f"relocate_share is {relocate_share}; it is a share of the strokes, at most 1.")
    if not distances_px or min(distances_px) < 1:
        raise ValueError(f"distances_px is {list(distances_px)}; give at least one distance, each 1 or more.")
