"""One step of the journey from a published folder to the lean runner, in a process of its own.

`python -m studies.published_sizes.parts PART --out DIR`; prints what is known beside time and memory, as JSON.
Each part imports what it needs, so that the runner's part holds no PyTorch.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

SIDE_PX = 512
SAMPLED_STEPS = 2
IMAGE_GUIDANCE, TEXT_GUIDANCE = 1.5, 7.5
"""As published."""
CAPTION = "a red disc"
Facts = dict[str, Any]


def write(out: Path) -> Facts:
    """The folders, with random weights in half precision, as they are published."""
    import torch

    from pentimento.copainting.goal.planner import save_goal_planner
    from pentimento.semantics.encoder import Encoder
    from studies.published_sizes.models import published_clip, published_planner

    planner = published_planner()
    save_goal_planner(planner.to(dtype=torch.float16), out / "planner")
    for name in ("b32", "l14"):
        (out / name).mkdir(parents=True, exist_ok=True)
        Encoder(published_clip(name), planner.tokenizer).save(out / name)
    return {"million_weights": sum(weight.numel() for weight in planner.unet.parameters()) / 1e6}


def load(out: Path) -> Facts:
    """The goal planner alone, in single precision."""
    _planner(out)
    return {}


def encoder_b32(out: Path) -> Facts:
    """CLIP ViT-B/32: value and gradient of a picture of 512 px."""
    return _encoder(out / "b32")


def encoder_l14(out: Path) -> Facts:
    """CLIP ViT-L/14: the same."""
    return _encoder(out / "l14")


def bfloat16(_: Path) -> Facts:
    """The time of a convolution in bfloat16, which a processor may only emulate, relative to float32."""
    import torch

    layer, values = torch.nn.Conv2d(320, 320, 3, padding=1), torch.randn(1, 320, 8, 8)
    taken_s = []
    for half in (False, True):
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, enabled=half):
            layer(values)
            started = time.process_time()
            for _repeat in range(5):
                layer(values)
            taken_s.append(time.process_time() - started)
    return {"ratio": taken_s[1] / taken_s[0]}


def lora(out: Path) -> Facts:
    """A step of low-rank updates, rank 16."""
    from pentimento.copainting.goal.denoising import Lora

    return _training(out, Lora(16, 16))


def whole(out: Path) -> Facts:
    """A step of all weights."""
    return _training(out, None)


def sample(out: Path) -> Facts:
    """A goal of a few steps, each with three evaluations, in PyTorch."""
    from pentimento.copainting.goal.planner import SeededSampling, complete

    goal = complete(
        _planner(out), _canvas(), [CAPTION], SeededSampling(SAMPLED_STEPS, IMAGE_GUIDANCE, TEXT_GUIDANCE, seed=0)
    )
    np.save(out / "goal.npy", goal)
    return {}


def export(out: Path) -> Facts:
    """A bundle: every graph is compared with PyTorch, the goal planner's in half precision."""
    from pentimento.copainting.goal.planner import GoalSampling
    from pentimento.deploy.bundle import DeployConfig, Models, write_bundle
    from pentimento.dynamics.strokes.extended import base_model
    from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters
    from pentimento.semantics.encoder import Encoder
    from pipelines._config import load_section

    config = load_section(Path("params.yaml"), "deploy", DeployConfig)
    config = replace(
        config, half_tolerance=0.02, vocabulary=None, clays={}, settings={"marker": config.settings["marker"]},
        sampling=GoalSampling(SAMPLED_STEPS, IMAGE_GUIDANCE, TEXT_GUIDANCE),
    )  # fmt: skip
    marker = base_model(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 0.2, 1e-3, 0.15, 0.9))
    models = Models(
        {"marker": marker}, Encoder.load(out / "b32"), out / "b32", _planner(out), out / "planner", {},
        {"stroke_marker": "0", "semantics": "0", "goal": "0"},
    )  # fmt: skip
    (out / "bundle").mkdir()
    manifest = write_bundle(out / "bundle", models, config)
    return {
        "bundle_gb": sum(entry.bytes for entry in manifest.files.values()) / 1e9,
        "parity": json.loads((out / "bundle/metrics.json").read_text(encoding="utf-8")),
    }


def run(out: Path) -> Facts:
    """The bundle's check, and the same goal in the lean runner, without PyTorch."""
    from pentimento.bundle.graphs import Graphs, goal_networks, noise_schedule, tokenizer
    from pentimento.bundle.reader import open_bundle
    from pentimento.bundle.sampler import complete, normal, seed_for

    started = time.perf_counter()
    bundle = open_bundle(out / "bundle")
    opened_s = time.perf_counter() - started
    words = tokenizer(bundle, bundle.manifest.goal.words)
    goal = complete(
        goal_networks(Graphs(bundle)), noise_schedule(bundle), _canvas(),
        tokens=words.encode([CAPTION]), no_words=words.encode([""]),
        noise=normal((1, 4, SIDE_PX // 8, SIDE_PX // 8), seed_for(0, 0)),
        steps=SAMPLED_STEPS, image_guidance=IMAGE_GUIDANCE, text_guidance=TEXT_GUIDANCE,
    )  # fmt: skip
    difference = np.abs(goal.astype(int) - np.load(out / "goal.npy")).mean()
    return {"opened_s": opened_s, "difference_of_255": float(difference)}


def _planner(out: Path) -> Any:
    from pentimento.copainting.goal.planner import load_goal_planner

    return load_goal_planner(out / "planner")


def _canvas() -> Any:
    """Paper with a bar on it, uint8 [1, 512, 512, 3]."""
    canvas = np.full((1, SIDE_PX, SIDE_PX, 3), 240, np.uint8)
    canvas[:, 200:230, 100:400] = 30
    return canvas


def _encoder(folder: Path) -> Facts:
    import torch

    from pentimento.semantics.encoder import Encoder

    encoder = Encoder.load(folder)
    image = torch.rand(1, 3, SIDE_PX, SIDE_PX, requires_grad=True)
    cosine = encoder.embed_images(image) @ encoder.embed_texts([CAPTION]).T
    (gradient,) = torch.autograd.grad(cosine.sum(), image)
    return {"gradient": float(gradient.norm())}


def _training(out: Path, updates: Any) -> Facts:
    from pentimento.copainting.goal.denoising import GoalTraining, encode_pairs
    from pentimento.copainting.goal.training import computed_precision, train_goal_planner
    from pentimento.copainting.scenes.edits import Pair

    planner = _planner(out)
    config = GoalTraining(
        **profile_training() | {"steps": 2, "batch": 1, "lora": updates, "checkpoint_every": 2, "warm_up": 0}
    )
    pairs = encode_pairs(planner, [Pair(255 - _canvas()[0], _canvas()[0], CAPTION)], config.precision)
    told_s: list[float] = []  # CPU seconds at each loss, behind the step's forward pass: a whole step lies between two
    losses = train_goal_planner(
        planner, pairs, config, scratch=None, log=lambda _name, _value, _step: told_s.append(time.process_time())
    )
    return {"losses": losses, "step_cpu_s": told_s[1] - told_s[0], "precision": computed_precision(config)}


def profile_training() -> dict[str, Any]:
    """The section `finetune_goal_planner.training` of the profile `full`."""
    from pipelines._params import overlaid, resolved

    training: dict[str, Any] = resolved(overlaid(Path(), "full"))["finetune_goal_planner"]["training"]
    return training


PARTS: dict[str, Callable[[Path], Facts]] = {
    each.__name__: each for each in (write, load, encoder_b32, encoder_l14, bfloat16, lora, whole, sample, export, run)
}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.published_sizes.parts", description=__doc__)
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    print(json.dumps(PARTS[args.part](args.out)))


if __name__ == "__main__":
    main()
