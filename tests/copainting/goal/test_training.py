"""Targets and weights of the denoising loss, learning, and resumed training."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from diffusers import DDIMScheduler

from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.copainting.goal import denoising
from pentimento.copainting.goal.denoising import Lora, encode_pairs, loss_weight, wanted_output
from pentimento.copainting.goal.planner import GoalPlanner
from pentimento.copainting.goal.training import latest_checkpoint, train_goal_planner
from pentimento.semantics.devices import precision_on
from tests.copainting.goal_planners import CAPTIONS, TRAINING, small_pairs, small_planner, trained, uninterrupted


def equal(one: GoalPlanner, other: GoalPlanner) -> bool:
    weights = ([*p.unet.state_dict().values(), *p.text_encoder.state_dict().values()] for p in (one, other))
    return all(torch.equal(a, b) for a, b in zip(*weights, strict=True))


@pytest.mark.parametrize(("killed_at", "lora"), [(1, None), (2, Lora(2, 4)), (3, Lora(2, 4)), (5, None)])
def test_resumed_training_equals_uninterrupted_training(tmp_path: Path, killed_at: int, lora: Lora | None) -> None:
    config = replace(TRAINING, lora=lora)
    trained(config, tmp_path, until=killed_at)
    assert (latest_checkpoint(tmp_path) is None) == (killed_at < config.checkpoint_every)
    (tmp_path / "step-00000009.part").write_bytes(b"half of a checkpoint")  # ignored
    resumed, whole = trained(config, tmp_path), uninterrupted(config)
    assert equal(resumed.planner, whole.planner)
    assert resumed.losses == whole.losses and len(whole.losses) == config.steps
    assert len(list(tmp_path.glob("*.ckpt"))) == 1


@pytest.mark.parametrize("lora", [None, Lora(2, 4)])
def test_gradient_checkpointing_gives_the_same_weights(lora: Lora | None) -> None:
    config = replace(TRAINING, lora=lora, train_text=lora is None, steps=3)
    kept, recomputed = trained(config), trained(replace(config, gradient_checkpointing=True))
    assert recomputed.losses == pytest.approx(kept.losses, rel=1e-6)
    assert torch.allclose(recomputed.weights, kept.weights, atol=1e-6)


def test_without_an_average_the_last_weights_are_taken(tmp_path: Path) -> None:
    config = replace(TRAINING, ema_decay=0.0, steps=4)
    last, averaged = trained(config, tmp_path), trained(replace(config, ema_decay=0.9))
    state = torch.load(latest_checkpoint(tmp_path), weights_only=True)["state_dict"]
    of_checkpoint = {name.removeprefix("unet."): weight for name, weight in state.items() if name.startswith("unet.")}
    assert all(torch.equal(weight, of_checkpoint[name]) for name, weight in last.planner.unet.state_dict().items())
    assert not any(name.startswith("average") for name in state)
    assert not equal(last.planner, averaged.planner)


def test_frozen_parts_do_not_change() -> None:
    before, after = small_planner(), trained(replace(TRAINING, train_text=False)).planner

    def same(part: str) -> list[bool]:
        parameters = (getattr(planner, part).parameters() for planner in (before, after))
        return [torch.equal(a, b) for a, b in zip(*parameters, strict=True) if a.ndim > 1]

    assert all(same("text_encoder")) and all(same("vae"))
    assert not any(same("unet"))


def test_lora_gives_a_plain_unet_with_low_rank_updates() -> None:
    before, after = small_planner(), trained(replace(TRAINING, lora=Lora(1, 4), train_text=False)).planner
    assert before.unet.state_dict().keys() == after.unet.state_dict().keys()
    ranks = []
    for name, weight in before.unet.state_dict().items():
        change = after.unet.state_dict()[name] - weight
        if name.endswith("to_q.weight"):
            ranks.append(int(torch.linalg.matrix_rank(change, atol=1e-5)))
        if name.endswith("norm1.weight"):
            assert not change.any()
    assert ranks and set(ranks) == {1}


def test_training_lowers_the_loss() -> None:
    planner = small_planner()
    pairs = encode_pairs(planner, small_pairs(4))
    config = replace(TRAINING, steps=80, batch=4, learning_rate=5e-3, drop_text=0, drop_image=0, drop_both=0)
    losses = train_goal_planner(planner, pairs, config, scratch=None, log=lambda *_: None)
    assert np.mean(losses[-20:]) < 0.4 * np.mean(losses[:5])


def test_dropped_text_does_not_affect_training() -> None:
    """With all text dropped, other captions give the same weights; with it, they do not."""

    def after(drop_text: float, captions: Callable[[int], str]) -> GoalPlanner:
        planner = small_planner()
        pairs = [replace(pair, caption=captions(i)) for i, pair in enumerate(small_pairs(4))]
        config = replace(TRAINING, drop_text=drop_text, drop_image=0, drop_both=0, steps=2)
        train_goal_planner(planner, encode_pairs(planner, pairs), config, scratch=None, log=lambda *_: None)
        return planner

    one, other = (lambda i: CAPTIONS[i]), (lambda i: CAPTIONS[-1 - i])
    assert equal(after(1.0, one), after(1.0, other))
    assert not equal(after(0.0, one), after(0.0, other))


@pytest.mark.parametrize("prediction", ["epsilon", "v_prediction", "sample"])
def test_ddim_recovers_clean_latents_from_the_training_target(prediction: str) -> None:
    """x0 = (x - σ ε)/α, or α x - σ v, or the output itself: DDIM's own formula gives the clean latents back."""
    scheduler = DDIMScheduler(prediction_type=prediction, clip_sample=False)
    clean, noise = torch.randn(2, 4, 4, 4), torch.randn(2, 4, 4, 4)
    for time in (0, 400, 990):
        times = torch.full((2,), time)
        noisy = scheduler.add_noise(clean, noise, times)
        wanted = wanted_output(scheduler, clean, noise, times)
        scheduler.set_timesteps(1000)
        found = scheduler.step(wanted, time, noisy).pred_original_sample
        assert torch.allclose(found, clean, atol=5e-3)


def test_min_snr_weights_clean_latent_errors_equally_for_all_predictions() -> None:
    """An error e of x0 is one of α/σ e in the noise and e/σ in the velocity: weighted, they are min(SNR, γ) e²."""
    times = torch.tensor([1, 50, 300, 700, 950])
    signal = DDIMScheduler().alphas_cumprod[times]
    ratio = signal / (1 - signal)
    scale = {"sample": torch.ones(5), "epsilon": ratio, "v_prediction": 1 / (1 - signal)}
    for prediction, factor in scale.items():
        weight = loss_weight(DDIMScheduler(prediction_type=prediction), times, 5.0)
        assert torch.allclose(weight * factor, ratio.clamp(max=5.0), rtol=1e-4)
    assert (loss_weight(DDIMScheduler(), times, None) == 1).all()


def test_encoded_pairs_share_pictures_and_reject_mixed_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    planner, pairs = small_planner(), small_pairs(6)
    latents = encode_pairs(planner, pairs)
    assert len(latents.latents) == 1 + len({pair.target.tobytes() for pair in pairs})  # one blank paper for all
    assert latents.tokens.shape == (6, planner.tokenizer.model_max_length)
    monkeypatch.setattr("torch.cpu._is_avx512_bf16_supported", lambda: False)
    precision_on.cache_clear()
    assert torch.equal(encode_pairs(planner, pairs, "bf16-mixed").latents, latents.latents)
    monkeypatch.setattr(denoising, "precision_on", lambda _, wanted: wanted)
    precision_on.cache_clear()
    half = encode_pairs(planner, pairs, "bf16-mixed").latents
    assert half.dtype == torch.float32
    assert 0 < float((half - latents.latents).norm() / latents.latents.norm()) < 0.02
    odd = replace(pairs[0], input=pairs[0].input[:8], target=pairs[0].target[:8])
    with pytest.raises(ContractError, match="2 sizes"):
        encode_pairs(planner, [*pairs, odd])
    with pytest.raises(ContractError, match="no pair"):
        encode_pairs(planner, [])


def test_a_step_that_does_not_fit_into_memory_says_what_to_change(monkeypatch: pytest.MonkeyPatch) -> None:
    planner = small_planner()

    def forward(*_: object, **__: object) -> None:
        raise torch.OutOfMemoryError("CUDA out of memory.\nmore")

    monkeypatch.setattr(planner.unet, "forward", forward)
    pairs = encode_pairs(planner, small_pairs(2))
    with pytest.raises(PentimentoError, match=r"A batch of 3 pairs does not fit .*\(CUDA out of memory\.\); halve"):
        train_goal_planner(planner, pairs, TRAINING, scratch=None, log=lambda *_: None)
