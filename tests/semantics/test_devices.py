"""The device that is chosen, batches halved where memory ends, and results that do not depend on either."""

import numpy as np
import pytest
import torch

from pentimento.contracts.errors import ConfigError, PentimentoError
from pentimento.copainting.goal.planner import SeededSampling, complete
from pentimento.copainting.goal.vae import as_model_input, encode, round_trip
from pentimento.semantics.devices import VARIABLE, chosen_device, in_batches, precision_on
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.scores import embed_all, saliency
from tests.copainting.goal_planners import CAPTIONS, SIDE_PX, small_encoder, small_planner

OTHER = "cuda" if torch.cuda.is_available() else "mps" if torch.backends.mps.is_available() else None


def pictures(number: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (number, SIDE_PX, SIDE_PX, 3)).astype(np.uint8)


def test_the_device_is_the_cpu_unless_the_machine_says_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert chosen_device().type == "cpu"
    monkeypatch.setenv(VARIABLE, "auto")
    assert chosen_device().type == (OTHER or "cpu")


def test_a_device_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "tpu")
    with pytest.raises(ConfigError, match="must be one of cpu, cuda, mps, auto"):
        chosen_device()
    monkeypatch.setenv(VARIABLE, "cuda")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(ConfigError, match="finds no such device"):
        chosen_device()


def test_a_cpu_without_bfloat16_computes_in_float32_and_says_so_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for has, computed in ((True, "bf16-mixed"), (False, "32-true")):
        precision_on.cache_clear()
        monkeypatch.setattr("torch.cpu._is_avx512_bf16_supported", lambda has=has: has)
        assert [precision_on("cpu", "bf16-mixed") for _ in range(2)] == [computed] * 2
        assert precision_on("cuda", "bf16-mixed") == "bf16-mixed"
        assert precision_on("cpu", "32-true") == "32-true"
        assert len(caplog.messages) == (not has)
    assert "no instructions for bfloat16" in caplog.text
    precision_on.cache_clear()


@pytest.mark.parametrize("fits", [1, 2, 3, 7, 100])
def test_batches_are_halved_until_they_fit_and_stay_so(fits: int) -> None:
    asked: list[int] = []

    def function(part: slice) -> list[int]:
        asked.append(part.stop - part.start)
        if asked[-1] > fits:
            raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2 GiB")
        return list(range(part.start, part.stop))

    parts = in_batches(function, 21, 16)
    assert [item for part in parts for item in part] == list(range(21))
    assert max(map(len, parts)) <= fits
    failed = [size for size in asked if size > fits]
    assert failed == sorted(failed, reverse=True)  # none is tried again in a size that did not fit


def test_an_item_that_does_not_fit_is_an_error_with_a_way_out() -> None:
    def function(_: slice) -> None:
        raise torch.OutOfMemoryError("CUDA out of memory.")

    with pytest.raises(PentimentoError, match=r"too little memory for a single picture \(CUDA out of memory\.\)"):
        in_batches(function, 3, 8)


class _Small:
    """A network that fits into memory for so many items only."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, owner: object, name: str, fits: int) -> None:
        self._whole, self._fits, self.failed = getattr(owner, name), fits, 0
        monkeypatch.setattr(owner, name, self)

    def __call__(self, given: torch.Tensor, *arguments: object, **keywords: object) -> object:
        if len(given) > self._fits:
            self.failed += 1
            raise torch.OutOfMemoryError("CUDA out of memory.")
        return self._whole(given, *arguments, **keywords)


def test_latents_pictures_and_vectors_are_the_same_in_smaller_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    planner, encoder = small_planner(), small_encoder()
    images = torch.rand(11, 3, SIDE_PX, SIDE_PX)
    sampling = SeededSampling(2, 1.2, 2.0, 0)

    def results() -> list[np.ndarray]:
        return [
            encode(planner.vae, pictures(11)).numpy(),
            round_trip(planner.vae, pictures(11)).astype(float),
            complete(planner, pictures(11), (CAPTIONS * 3)[:11], sampling).astype(float),
            embed_all(encoder, images).numpy(),
        ]

    before = results()
    smalls = [
        _Small(monkeypatch, planner.vae, "encode", 4),
        _Small(monkeypatch, planner.vae, "decode", 3),
        _Small(monkeypatch, encoder, "embed_images", 2),
    ]
    after = results()
    assert all(small.failed for small in smalls)
    for one, other, step in zip(before, after, (1e-4, 1, 1, 1e-5), strict=True):
        np.testing.assert_allclose(one, other, atol=step)  # a batch may sum in another order


def test_on_the_cpu_nothing_changes_by_a_bit() -> None:
    """The parts called by hand, in the batches of the code, give the same bits."""
    planner, encoder = small_planner(), small_encoder()
    with torch.no_grad():
        by_hand = planner.vae.encode(as_model_input(pictures(5))).latent_dist.mode()
        images = torch.rand(5, 3, 24, 24)
        features = encoder.model.get_image_features(pixel_values=encoder.prepare(images)).pooler_output
    assert torch.equal(encode(planner.vae, pictures(5)), by_hand)
    assert torch.equal(embed_all(encoder, images), torch.nn.functional.normalize(features, dim=-1))


@pytest.mark.skipif(OTHER is None, reason="no GPU: networks on a device other than the CPU are NOT tested")
def test_another_device_gives_the_cpus_results_up_to_rounding(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("encoder")
    small_encoder().save(folder)
    images = torch.rand(3, 3, 24, 24)

    def results() -> list[torch.Tensor]:
        planner, encoder = small_planner(), Encoder.load(folder)
        seen = images.clone().requires_grad_()
        (encoder.embed_images(seen) @ encoder.embed_texts(CAPTIONS[:1]).T).sum().backward()  # type: ignore[no-untyped-call]
        assert seen.grad is not None
        completed = complete(planner, pictures(3), CAPTIONS[:3], SeededSampling(3, 1.2, 2.0, 0))
        return [
            encode(planner.vae, pictures(3)),
            torch.from_numpy(completed) / 255,
            seen.grad,
            encoder.patch_features(images),
            saliency(encoder, images, CAPTIONS[:3]),
        ]

    monkeypatch.setenv(VARIABLE, "cpu")
    before = results()
    monkeypatch.setenv(VARIABLE, str(OTHER))
    for one, other in zip(before, results(), strict=True):
        torch.testing.assert_close(one, other, atol=0.01, rtol=0.01)
