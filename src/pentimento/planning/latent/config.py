"""How strokes of a hand are planned: every number, with its unit."""

from __future__ import annotations

from dataclasses import dataclass

from pentimento.contracts.ranges import above_zero, at_least


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
