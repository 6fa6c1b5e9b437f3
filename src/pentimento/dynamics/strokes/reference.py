"""The dense stroke renderer in plain PyTorch: the slow, readable reference for the compiled kernel.

It evaluates every segment at every pixel, with the formula and the floors of ``pentimento.render.kernel``, which
explains the two corrections to the thesis's equations (5.1) and (5.2).
"""

from __future__ import annotations

import torch
from torch import Tensor

from pentimento.render.coverage import HALF_PX, R_MIN, RIM_PX
from pentimento.render.strokes import PixelStrokes


def stroke_coverage(
    points: Tensor, radius: Tensor, density: Tensor, softness: Tensor, shape: tuple[int, int]
) -> tuple[Tensor, Tensor]:
    """Coverage of one stroke at every pixel (thesis 5.1 to 5.5), and which of its segments covers it.

    Args:
        points: [N, 2] pixel coordinates (column, row); one point alone is a disc.
        radius, density, softness: [N], radius in px.
        shape: (H, W).

    Returns:
        [H, W], 0 where no ink falls; and int64[H, W].
    """
    if len(points) == 1:
        points, radius, density, softness = (
            x.repeat(2, *[1] * (x.ndim - 1)) for x in (points, radius, density, softness)
        )
    height, width = shape
    rows = torch.arange(height, dtype=points.dtype)
    columns = torch.arange(width, dtype=points.dtype)
    grid = torch.stack(torch.meshgrid(columns, rows, indexing="xy"), dim=-1)  # [H, W, 2]
    u, v = points[:-1], points[1:]  # [K, 2]
    edge = v - u
    offset = grid[None] - u[:, None, None]  # [K, H, W, 2]
    length2 = edge.square().sum(-1).clamp(min=1e-12)[:, None, None]
    t = ((offset * edge[:, None, None]).sum(-1) / length2).clamp(0.0, 1.0)  # [K, H, W]  (5.2), sign kept
    apart2 = (offset - t[..., None] * edge[:, None, None]).square().sum(-1)
    # A square root has no slope at 0; where the pixel lies on the path, any subgradient will do: 0.
    on_path = apart2 == 0
    distance = torch.where(on_path, 0.0, torch.where(on_path, 1.0, apart2).sqrt())  # (5.1), to the segment

    def along(values: Tensor) -> Tensor:  # (5.3)
        return values[:-1, None, None] + t * (values[1:] - values[:-1])[:, None, None]

    thickness = along(radius).clamp(min=R_MIN)  # (5.4) is applied by the caller
    edge = torch.minimum(thickness, distance + HALF_PX) + torch.minimum(thickness, HALF_PX - distance)
    q = ((thickness - distance).clamp(min=RIM_PX) / thickness).clamp(max=1.0)
    coverage = along(density) * q ** along(softness) * edge.clamp(min=0.0)  # (5.5)
    constant = bool((density == density[0]).all() and (softness == softness[0]).all())
    nearness = torch.where(edge > 0, -distance / thickness, -torch.inf)
    chosen = (nearness if constant else coverage).argmax(dim=0)
    return coverage.gather(0, chosen[None])[0], chosen


def render_reference(strokes: PixelStrokes[Tensor], canvas: Tensor) -> Tensor:
    """Lay strokes on one canvas, in order.

    Args:
        strokes: of this canvas; for ``pickup`` see ``pentimento.render.composition``.
        canvas: [H, W, 3], linear light; with ``strokes.pickup`` [H, W, 4], the last channel being wetness.

    Returns:
        The image, of the canvas's shape.
    """
    points, radius, density, softness, color, pickup = strokes
    image, shape = canvas, (canvas.shape[0], canvas.shape[1])
    for s in range(len(points)):
        alpha, segment = stroke_coverage(points[s], radius[s], density[s], softness[s], shape)
        if pickup is None:
            laid = color[s]
        else:
            # The sums over what was passed up to each segment, and back to the pixels that it covers: [H, W].
            passed = [(segment <= k) * alpha for k in range(max(points.shape[1] - 1, 1))]
            wet = [(p[..., None] * image[..., 3:] * (image[..., :3] - color[s])).sum((0, 1)) for p in passed]
            carried = torch.stack([w / p.sum().clamp(min=1e-12) for w, p in zip(wet, passed, strict=True)])
            stirred = image[..., 3:] * (image[..., :3] - color[s])
            mixed = color[s] + pickup[s] * (stirred + carried[segment])
            laid = torch.cat([mixed, torch.ones_like(image[..., :1])], dim=-1)
        image = image + alpha[..., None] * (laid - image)
    return image
