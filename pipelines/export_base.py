"""Write the base that ships: its models in half precision, with hashes and a card."""

import argparse
import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save_file

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import PentimentoError
from pentimento.copainting.drawings.sources import LICENCES, vocabulary
from pipelines._io import output_folder, stage_main, write_json
from pipelines._params import read_params
from pipelines._tracking.dvc_files import input_digests

_MAX_BYTES = 60_000_000  # together: what a repository can carry
_LICENCE = "CC-BY-SA-4.0"  # of the drawings, and so of what learned from them


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: semantics/, judge/ and goal/ in half precision, base.json and card.md."""
    parts = {"semantics": arguments.semantics, "judge": arguments.judge, "goal": arguments.goal}
    with output_folder(arguments.out) as out:
        for name, folder in parts.items():
            copy_in_half_precision(folder, out / name)
        files = sorted(file for file in out.rglob("*") if file.is_file())
        size = sum(file.stat().st_size for file in files)
        if size > _MAX_BYTES:
            raise PentimentoError(
                f"The base has {size / 1e6:.0f} MB, at most {_MAX_BYTES / 1e6:.0f} MB ship; take a smaller UNet."
            )
        metrics = {
            name: json.loads((folder / "metrics.json").read_text(encoding="utf-8")) for name, folder in parts.items()
        }
        write_json(
            out / "base.json",
            {
                "licence": _LICENCE,
                "sources": LICENCES,
                "params": read_params(arguments.params),
                "models": input_digests(parts),
                "metrics": metrics,
                "sha256": {
                    file.relative_to(out).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest() for file in files
                },
            },
        )
        atomic_write(out / "card.md", _card(read_params(arguments.params), metrics, size).encode())


def copy_in_half_precision(source: Path, target: Path) -> None:
    """Copy a model's folder; floating-point tensors of safetensors files become float16. Training records stay behind.

    Raises:
        PentimentoError: a weight is too large for float16.
    """
    for file in sorted(source.rglob("*")):
        if not file.is_file() or file.name in ("metrics.json", "curve.json", "guidance.png"):
            continue
        copy = target / file.relative_to(source)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if file.suffix != ".safetensors":
            shutil.copyfile(file, copy)
            continue
        tensors = {name: t.half() if t.is_floating_point() else t for name, t in load_file(file).items()}
        for name, tensor in tensors.items():
            if tensor.is_floating_point() and not torch.isfinite(tensor).all():
                raise PentimentoError(f"{file}: {name} exceeds the range of float16; train it again with weight decay.")
        save_file(tensors, copy, metadata={"format": "pt"})


def _card(params: dict[str, Any], metrics: dict[str, Any], size: int) -> str:
    drawn_by = params["draw_scenes"]
    of_judge = "\n".join(f"- {source} ({LICENCES[source]})" for source in drawn_by["judge"]["sources"])
    goal, phases = metrics["goal"], params["train_goal_base"]["phases"]
    compositions = goal["compositions"]
    rows = "\n".join(
        f"| {name.replace('_', '-')} compositions | {scores['mse']:.4f} | {scores['mse_of_copying']:.4f} |"
        for name, scores in compositions.items()
    )
    steps = " + ".join(str(phase["training"]["steps"]) for phase in phases)
    return f"""# Base of the goal planner

An Instruct-Pix2Pix model of {goal["parameters"]["unet"] / 1e6:.1f} million UNet parameters for pictures of
{params["train_goal_base"]["side_px"]} x {params["train_goal_base"]["side_px"]} px, with the text-image encoder that it
reads prompts with and a judge. {size / 1e6:.0f} MB in half precision. `make base` trains it; base.json holds the
parameters, hashes and metrics.

**Licence of the weights: CC BY-SA 4.0.** Goal planner and encoder learned from drawings of {len(vocabulary())} nouns by
[OpenMoji](https://openmoji.org) (CC BY-SA 4.0). The project's code is under the MIT licence. The judge learned from
drawings of the same nouns by others:

{of_judge}

**Training.** {steps} steps of {phases[0]["training"]["batch"]} pairs: a window of a canvas, and the same with one more
thing that fills it; half of them pen drawings and half painted. Pairs of a noun and what stands beside it are held out
by a hash of their words.

| mean squared error (sRGB, 0 to 1) | completions | of changing nothing |
|---|---|---|
{rows}

**Limits.** It draws one thing at a time; `pentimento.control.layout` gives each thing of a request a window of its own.
It knows the nouns of `src/pentimento/copainting/drawings/vocabulary.toml`, mostly in one view each. It does not draw
people, faces or letters.
"""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="export_base", description=__doc__)
    parser.add_argument("--params", required=True, type=Path)
    parser.add_argument("--semantics", required=True, type=Path)
    parser.add_argument("--judge", required=True, type=Path)
    parser.add_argument("--goal", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
