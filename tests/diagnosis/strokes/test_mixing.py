"""The power of light in which paint and ground mix is estimated, and is linear by default."""

from dataclasses import replace

import pytest
import torch

from pentimento.contracts.colour import linear_to_srgb
from pentimento.contracts.strokes import example_table
from pentimento.diagnosis.strokes.fit import choose_mixing, first_model, fit
from pentimento.diagnosis.strokes.measured import Measured, load_measured
from pentimento.diagnosis.strokes.model import BASE, Model
from pentimento.diagnosis.strokes.predict import ink, predicted_linear


@pytest.fixture(scope="module")
def measured() -> Measured:
    return load_measured(example_table(48))


def pale_red(measured: Measured, mixing: float) -> tuple[Model, Measured]:
    """A plain base, and noisy photographs of pale red that lies over grey in every second window."""
    samples, plain = measured.samples, fit(first_model(measured), measured)
    grey = torch.where(torch.arange(len(measured)) % 2 == 0, 1.0, 0.3)[:, None, None, None] * samples.before_linear
    before, red = torch.from_numpy(linear_to_srgb(grey.numpy())), torch.tensor([0.75, 0.2, 0.35])
    samples = samples._replace(before=before, before_linear=grey, color=red.expand(len(measured), 3))
    pale = plain.base.copy()
    pale[BASE.index("slab_1")], pale[BASE.index("mixing")] = 0.6, mixing
    seen = replace(measured, samples=samples)
    after = linear_to_srgb(predicted_linear(ink(replace(plain, base=pale), seen), seen))
    noise = 0.004 * torch.randn(after.shape, generator=torch.Generator().manual_seed(0))
    return plain, replace(measured, samples=samples._replace(after=torch.from_numpy(after) + noise))


def test_detects_mixing_in_srgb_numbers(measured: Measured) -> None:
    plain, observed = pale_red(measured, -0.8)
    in_light = fit(plain, observed)
    assert in_light.mixes_in_light
    # What holds numbers near the plainest base goes with the error at the start of a fit.
    found = fit(choose_mixing(in_light, observed, 0), observed)
    assert found.base[BASE.index("mixing")] == pytest.approx(-0.8, abs=0.15)


def test_keeps_mixing_in_linear_light(measured: Measured) -> None:
    plain, observed = pale_red(measured, 0.0)
    assert choose_mixing(fit(plain, observed), observed, 0).mixes_in_light
