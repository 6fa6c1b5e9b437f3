"""The stroke's own frame: there and back, and images that land where their path lies."""

import numpy as np
import pytest
import torch

from pentimento.dynamics.strokes.samples import StrokeSamples
from studies.stroke_models.networks.frame import crop_around, cut, frames_of, local_paths, place


def test_a_path_starts_at_the_origin_and_ends_on_the_x_axis(made_by_truth: StrokeSamples) -> None:
    path = made_by_truth.path
    local = local_paths(path)
    chord = (path[:, -1, 1:3] - path[:, 0, 1:3]).norm(dim=-1)
    torch.testing.assert_close(local[:, 0], torch.zeros(len(path), 2))
    torch.testing.assert_close(
        local[:, -1], torch.stack([chord, torch.zeros_like(chord)], dim=-1), atol=1e-8, rtol=1e-4
    )
    torch.testing.assert_close(frames_of(path).to_canvas(local), path[..., 1:3])


def test_a_path_that_ends_where_it_began_keeps_the_canvas_axes() -> None:
    path = torch.zeros(1, 5, 5)
    path[0, :, 1] = torch.tensor([0.1, 0.12, 0.12, 0.1, 0.1])
    path[0, :, 2] = torch.tensor([0.2, 0.2, 0.21, 0.21, 0.2])
    torch.testing.assert_close(local_paths(path)[0], path[0, :, 1:3] - path[0, 0, 1:3])


def test_a_crop_holds_its_paths_and_is_symmetric(made_by_truth: StrokeSamples) -> None:
    crop = crop_around(made_by_truth.path, 0.004, 1000.0, 8)
    assert crop.height % 8 == crop.width % 8 == 0
    assert crop.pixels_per_m == pytest.approx(1000.0)
    places = crop.places_m()
    torch.testing.assert_close(places[..., 1], -places[..., 1].flip(0))
    at = crop.to_pixels(local_paths(made_by_truth.path))
    assert (at >= 3).all()
    assert (at[..., 0] <= crop.width - 4).all()
    assert (at[..., 1] <= crop.height - 4).all()
    row, column = 3, 5
    assert crop.to_pixels(places[row, column]).tolist() == pytest.approx([column, row], abs=1e-3)


def test_what_is_drawn_on_the_path_lands_on_the_path(made_by_truth: StrokeSamples) -> None:
    """A spot at the end of the chord is seen at the commanded end, whatever the heading."""
    crop = crop_around(made_by_truth.path, 0.01, 1000.0, 2)
    end = local_paths(made_by_truth.path)[:, -1]
    spot = torch.exp(-((crop.places_m() - end[:, None, None]) / 0.002).square().sum(-1) / 2)
    seen = place(spot, crop, made_by_truth)
    height, width = seen.shape[1:]
    row, column = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    mass = seen.sum((1, 2))
    middle = torch.stack([(seen * column).sum((1, 2)), (seen * row).sum((1, 2))], dim=-1) / mass[:, None]
    wanted = made_by_truth.view.to_pixels(made_by_truth.path[:, -1, 1:3])
    inside = ((wanted > 7) & (wanted < torch.tensor([width - 8, height - 8]))).all(-1)
    assert inside.sum() > 5
    torch.testing.assert_close(middle[inside], wanted[inside], atol=0.1, rtol=0)
    np.testing.assert_allclose(mass[inside], 2 * np.pi * 2.0**2, rtol=0.02)  # areas are kept


def test_cutting_undoes_placing(made_by_truth: StrokeSamples) -> None:
    crop = crop_around(made_by_truth.path, 0.002, 1000.0, 2)
    x, y = crop.places_m().unbind(-1)
    smooth = torch.exp(-((x - 0.006).square() + y.square()) / (2 * 0.003**2)).expand(len(made_by_truth.path), -1, -1)
    stretch = torch.full((len(made_by_truth.path),), 1.3)
    again = cut(place(smooth, crop, made_by_truth, stretch), crop, made_by_truth, stretch)
    assert (again - smooth).abs().max() < 0.06  # bilinear sampling, twice
