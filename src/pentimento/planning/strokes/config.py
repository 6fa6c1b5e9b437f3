"""How a plan is made: every number that the planner needs, with its unit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from pentimento.contracts.ranges import above_zero, at_least
from pentimento.planning.strokes.palette import PaletteChoice

Log = Callable[[str, float, int], None]


def no_log(_name: str, _value: float, _step: int) -> None:
    """A `Log` that discards its values."""


@dataclass(frozen=True)
class LearningRates:
    """Adam's step for each kind of number, at its largest: a schedule lowers all alike."""

    middle_m: float
    theta_rad: float
    length_m: float
    bend_m: float
    press_m: float
    color: float
    """Of a stroke's colour where it is free, and of a paint's where strokes share it; linear light."""

    def __post_init__(self) -> None:
        at_least(self, 0, "middle_m", "theta_rad", "length_m", "bend_m", "press_m", "color")


@dataclass(frozen=True)
class ExecutionNoise:
    """What execution may take from a stroke and the plan leaves room for: drawn for each stroke at each iteration."""

    thinning: float
    """A stroke comes out thinner by up to this share: paint runs low, the brush lags."""
    shift_m: float
    """Standard deviation of its place, along each axis."""

    def __post_init__(self) -> None:
        at_least(self, 0, "thinning", "shift_m")
        if self.thinning >= 1:
            raise ValueError(f"thinning is {self.thinning}; below 1, strokes do not vanish.")

    def any(self) -> bool:
        """Whether there is any."""
        return self.thinning > 0 or self.shift_m > 0


@dataclass(frozen=True)
class StyleConfig:
    """The style objective."""

    weight: float
    """Beside a print objective of weight 1, .02 is seen in a painting and .08 recolours it."""
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
class ObjectivesConfig:
    """The weighted sum that a plan is optimised for (thesis eq. 4.5)."""

    print_weight: float
    style: StyleConfig | None

    def __post_init__(self) -> None:
        at_least(self, 0, "print_weight")
        if self.print_weight == 0 and self.style is None:
            raise ValueError("print_weight is 0 and style is null; give at least one objective a weight.")


@dataclass(frozen=True)
class PlannerConfig:
    """How a plan is made."""

    initialisation: Literal["random", "error_guided", "saliency"]
    """Where strokes start: anywhere (thesis 4.3.5), where the picture is wrong, or where it is wrong and stands out."""
    candidates: int
    """So many are tried for each new stroke, by rendering them; the one that helps most stays."""
    rounds: int
    """Strokes are added in so many rounds, from long and full to short and light."""
    sizes: tuple[float, float]
    """Of the first and the last round's strokes, 0 for the tool's shortest and lightest to 1 for its longest and
    fullest. Relocated strokes start like the last round's."""
    iterations_per_round: int
    """At half the resolution."""
    iterations_free: int
    """With free colours, after the last round."""
    iterations_palette: int
    """After the colours became paints and the strokes were ordered."""
    iterations_replan: int
    """After each photograph (thesis 4.3.5)."""
    replan_rate: float
    """Share of the learning rates that replanning uses: it starts near the optimum."""
    relocate_every: int
    """Iterations between two relocations of useless strokes; 0 for never."""
    relocate_share: float
    """Of the strokes: at most so many move each time."""
    min_gain: float
    """No round follows one in which a stroke lowered the objective by less than this on average; 0 spends them all."""
    palette: PaletteChoice
    sweeps: int
    """So many times the brush goes through the paints from light to dark, at most; 1 is the thesis's order."""
    path_points: int
    """Of the brush that is planned with."""
    pixels_per_m: float
    """Resolution of planning."""
    edge_m: float
    """Strokes keep this far from the canvas's edge."""
    distances_px: tuple[int, ...]
    """Viewing distances of the print objective."""
    objectives: ObjectivesConfig
    execution_noise: ExecutionNoise
    learning_rates: LearningRates
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 0, "iterations_per_round", "iterations_free", "iterations_palette", "iterations_replan")
        at_least(self, 0, "replan_rate", "relocate_every", "relocate_share", "min_gain", "edge_m", "seed")
        at_least(self, 1, "candidates", "rounds", "sweeps")
        at_least(self, 2, "path_points")
        if not all(0 <= size <= 1 for size in self.sizes):
            raise ValueError(f"sizes is {list(self.sizes)}; each is a share of the tool's range, from 0 to 1.")
        above_zero(self, "pixels_per_m")
        if self.relocate_share > 1:
            raise ValueError(f"relocate_share is {self.relocate_share}; it is a share of the strokes, at most 1.")
        if not self.distances_px or min(self.distances_px) < 1:
            raise ValueError(f"distances_px is {list(self.distances_px)}; give at least one distance, each 1 or more.")


@dataclass(frozen=True)
class HandRates:
    """Adam's step for each kind of number, at its largest: half a cosine lowers all alike."""

    middle_m: float
    theta_rad: float
    press_m: float
    shape: float
    """In standard deviations of what the hand draws; 0 leaves the shapes as they were drawn from it."""

    def __post_init__(self) -> None:
        at_least(self, 0, "middle_m", "theta_rad", "press_m", "shape")


@dataclass(frozen=True)
class HandPlanConfig:
    """How a drawing in a hand is planned (thesis 5.3.6)."""

    candidates: int
    """So many strokes of the hand are tried at each place, by rendering them; the one that helps most stays."""
    rounds: int
    """Strokes are added in so many rounds."""
    iterations_per_round: int
    iterations: int
    """After the last round."""
    relocate_every: int
    """Iterations between two relocations of useless strokes; 0 for never."""
    relocate_share: float
    """Of the strokes: at most so many move each time."""
    reach: float
    """A stroke's latent stays so near the demonstration that it began from, in standard deviations of the hand."""
    path_points: int
    """N, of the demonstrations and of each path."""
    pixels_per_m: float
    edge_m: float
    """Strokes keep this far from the canvas's edge."""
    distances_px: tuple[int, ...]
    """Viewing distances of the print objective."""
    learning_rates: HandRates
    seed: int

    def __post_init__(self) -> None:
        at_least(self, 1, "candidates", "rounds")
        at_least(self, 0, "iterations_per_round", "iterations", "relocate_every", "relocate_share", "reach", "edge_m")
        at_least(self, 0, "seed")
        at_least(self, 2, "path_points")
        above_zero(self, "pixels_per_m")
        if self.relocate_share > 1:
            raise ValueError(f"relocate_share is {self.relocate_share}; it is a share of the strokes, at most 1.")
        if not self.distances_px or min(self.distances_px) < 1:
            raise ValueError(f"distances_px is {list(self.distances_px)}; give at least one distance, each 1 or more.")
