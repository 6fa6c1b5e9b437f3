"""TrajVAE reconstructs strokes and adapts to a writer; the exported decoder agrees with it."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
import torch

from pentimento.contracts.errors import ContractError
from pentimento.handwriting import training
from pentimento.handwriting.demonstrated import Demonstrated, demonstrated, split_last_session
from pentimento.handwriting.evaluation import mean_stroke_mm, nearest_mm, reconstruction_mm
from pentimento.handwriting.training import Course, adapt, fine_tune, pretrain
from pentimento.handwriting.trajvae import Strokes, TrajVAE, decoder_of, generic_decoder, sizes_m
from studies.hands.sampling import sampled_strokes
from tests.handwriting.conftest import CONFIG, lengths_mm

Parts = tuple[Demonstrated, Demonstrated]


def unheard(*_: object) -> None: ...


def test_trajvae_beats_the_mean_stroke_on_test_sessions(model: TrajVAE, parts: Parts, curve: list[float]) -> None:
    learned, held_out = parts
    assert curve[-1] < 0.3 * curve[0]
    few, rest = learned.of("arcs").strokes.pick(torch.arange(10)), held_out.of("arcs").strokes
    assert reconstruction_mm(model, rest) < 0.5 * mean_stroke_mm(few, rest)
    assert nearest_mm(few, rest) < mean_stroke_mm(few, rest)
    assert nearest_mm(rest, rest) == 0


def test_fine_tuning_lowers_the_error_for_a_new_writer(parts: Parts) -> None:
    learned, held_out = parts
    others = learned.pick(np.array([hand != "zigzags" for hand in learned.hand]))
    model = pretrain(others.strokes, CONFIG, unheard)
    new = held_out.of("zigzags").strokes
    few, rest = new.pick(torch.arange(10)), new.pick(torch.arange(10, 16))
    own = fine_tune(model, few, others.strokes, CONFIG, unheard)
    assert reconstruction_mm(own, rest) < 0.8 * reconstruction_mm(model, rest)
    alone = fine_tune(model, few, few, CONFIG, unheard)  # nothing is rehearsed
    apart = held_out.of("loops").strokes
    assert reconstruction_mm(own, apart) < reconstruction_mm(alone, apart)
    assert reconstruction_mm(model, rest) == pytest.approx(
        reconstruction_mm(pretrain(others.strokes, CONFIG, unheard), rest)
    )


def test_adapting_to_a_new_writer_lowers_the_error(parts: Parts) -> None:
    learned, held_out = parts
    others = learned.pick(np.array([hand != "zigzags" for hand in learned.hand]))
    model = pretrain(others.strokes, CONFIG, unheard)
    new = held_out.of("zigzags").strokes
    few, rest = new.pick(torch.arange(10)), new.pick(torch.arange(10, 16))
    own = adapt(model, few, others.strokes, CONFIG, unheard)
    assert own.steps > 0 and own.gain_mm[0] > own.gain_mm[1] > 0
    assert reconstruction_mm(own.model, rest) < 0.9 * reconstruction_mm(model, rest)


def test_adapting_keeps_the_pretrained_weights_where_fine_tuning_is_worse(model: TrajVAE, parts: Parts) -> None:
    few = parts[1].of("arcs").strokes.pick(torch.arange(8))
    harmful = replace(CONFIG, fine_tuning=Course(16, 8, 0.3))
    own = adapt(model, few, parts[0].strokes, harmful, unheard)
    assert own.steps == 0 and own.gain_mm[0] < 0 and own.model is model


@pytest.mark.parametrize(
    ("errors_mm", "spread_mm", "steps"),
    [
        ((0.9, 0.8, 0.7, 0.6, 0.5), 0.0, 80),  # better until the end
        ((0.9, 0.7, 0.8, 1.1, 1.3), 0.0, 10),  # stops early
        ((1.1, 1.2, 1.3, 1.4, 1.5), 0.0, 0),
        ((0.99, 0.98, 0.97, 0.96, 0.95), 1.0, 0),  # a gain below its standard error
    ],
)
def test_fine_tuning_stops_where_held_out_strokes_are_best(
    errors_mm: tuple[float, ...], spread_mm: float, steps: int, parts: Parts, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = parts[1].of("arcs").strokes.pick(torch.arange(8))
    made: list[int] = []
    monkeypatch.setattr(training, "_tuned", lambda *_: iter(errors_mm))
    monkeypatch.setattr(training, "fine_tune", lambda *given: made.append(given[-1]))

    def errors(model: object, strokes: Strokes) -> torch.Tensor:
        mean = model if isinstance(model, float) else 1.0
        around = spread_mm if isinstance(model, float) else 0.0
        return mean + around * torch.tensor([1.0, -1.0])[: len(strokes.xy_m)]

    monkeypatch.setattr(training, "reconstruction_errors_mm", errors)
    own = adapt(None, few, parts[0].strokes, CONFIG, unheard)  # type: ignore[arg-type]
    assert own.steps == steps
    assert made == ([steps] if steps else [])


def test_decoder_agrees_with_the_model(model: TrajVAE, parts: Parts) -> None:
    strokes = parts[1].of("loops").strokes
    hand = decoder_of(model, strokes, "loops")
    latent = hand.sample(5, np.random.default_rng(0))
    with torch.no_grad():
        xy, _ = model.decode(torch.from_numpy(latent))
    np.testing.assert_allclose(hand.decode(latent)[0], xy.numpy(), atol=1e-6)
    assert hand.points == CONFIG.points


def test_samples_have_the_size_of_the_writers_strokes(model: TrajVAE, parts: Parts) -> None:
    for hand in ("dots", "arcs"):
        own = parts[0].of(hand).strokes
        decoder = decoder_of(model, own, hand)
        drawn = decoder.decode(decoder.sample(100, np.random.default_rng(1)))[0]
        assert np.median(lengths_mm(drawn)) == pytest.approx(np.median(lengths_mm(own.xy_m.numpy())), rel=0.25)
    nobody = generic_decoder(model)
    assert nobody.sample(3000, np.random.default_rng(2)).std() == pytest.approx(1, abs=0.02)


def test_unknown_heights_do_not_affect_the_loss(model: TrajVAE, parts: Parts) -> None:
    strokes = parts[0].strokes
    unknown = strokes._replace(height_known=torch.zeros_like(strokes.height_known))
    other = unknown._replace(height_m=unknown.height_m + 1.0)
    one, two = (model.loss(s, 1e-3, torch.Generator().manual_seed(0)).detach() for s in (unknown, other))
    assert float(one) == float(two)


def test_stroke_size_scales_linearly(model: TrajVAE) -> None:
    line = torch.stack([torch.linspace(0, 0.03, 16), torch.zeros(16)], dim=-1)[None]
    strokes = Strokes(line, torch.zeros(1, 16), torch.zeros(1))
    assert float(sizes_m(3 * strokes.xy_m)) == pytest.approx(3 * float(sizes_m(strokes.xy_m)))


def test_split_rejects_a_single_session(table: pa.Table) -> None:
    once = demonstrated(table, 16)
    alone = replace(once, session=tuple(once.hand))
    with pytest.raises(ContractError, match="one session"):
        split_last_session(alone)
    with pytest.raises(ContractError, match="no rows"):
        demonstrated(table.slice(0, 0), 16)


def test_samples_vary_as_the_known_strokes_do(model: TrajVAE, parts: Parts) -> None:
    few = parts[0].of("arcs").strokes
    drawn = sampled_strokes(model, few, 40, np.random.default_rng(3))
    np.testing.assert_allclose(drawn[:, 0], 0, atol=1e-12)
    np.testing.assert_allclose(drawn[:, -1, 1], 0, atol=1e-9)
    step = np.linalg.norm(np.diff(drawn, axis=1), axis=-1)
    assert (step.std(1) < 0.2 * step.mean(1)).all()
    assert np.median(lengths_mm(drawn)) == pytest.approx(np.median(lengths_mm(few.xy_m.numpy())), rel=0.3)
