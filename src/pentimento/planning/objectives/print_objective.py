"""The print objective (thesis 4.3): the painting should look like the target, seen from near and from farther off."""

from __future__ import annotations

from torch import Tensor
from torch.nn.functional import avg_pool2d

from pentimento.contracts.errors import ConfigError
from pentimento.stroke_dynamics.photometry import linear_to_srgb


class PrintObjective:
    """Mean squared difference in sRGB between an image and a target, averaged over viewing distances.

    From farther off, the eye averages light over squares before it compares: 1 px is the thesis's (4.3), larger squares
    see tone where a pixel sees only a black line on white.
    """

    def __init__(self, target: Tensor, distances_px: tuple[int, ...]) -> None:
        """Hold what there is to see of ``target``, [H, W, 3] in linear light.

        Raises:
            ConfigError: the picture is smaller than a distance's square.
        """
        height, width = target.shape[:2]
        if max(distances_px) > min(height, width):
            raise ConfigError(
                f"A viewing distance of {max(distances_px)} px is larger than the picture of {height} x {width} px: "
                "lower the planner's distances_px or raise its pixels_per_m."
            )
        self._seen = [(distance, seen_from(target, distance)) for distance in distances_px]

    def __call__(self, image: Tensor) -> Tensor:
        """The objective for an image [H, W, 3] in linear light; a scalar, differentiable."""
        losses = [(seen_from(image, distance) - target).square().mean() for distance, target in self._seen]
        return sum(losses[1:], losses[0]) / len(losses)


def seen_from(image: Tensor, distance_px: int) -> Tensor:
    """SRGB [3, h, w] of light averaged over squares of ``distance_px``; an edge that fills none is left out."""
    planes = image.movedim(-1, 0).contiguous()
    if distance_px > 1:
        # Squares overlap by half, so that no grid of theirs shows in the plan.
        planes = avg_pool2d(planes, distance_px, max(distance_px // 2, 1))
    return linear_to_srgb(planes)
