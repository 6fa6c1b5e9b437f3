"""Train two text-image encoders on the scenes: one that guides plans, and a judge that scores them."""

import argparse
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc
import torch
from torch import Tensor

from pentimento.contracts.errors import ContractError
from pentimento.contracts.ranges import above_zero, at_least
from pentimento.contracts.scenes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.semantics.encoder import Encoder, EncoderShape
from pentimento.semantics.examples import (
    VIEWS,
    Captioned,
    captioned,
    drawn_views,
    examples,
    is_black,
    kinds_of,
)
from pentimento.semantics.scores import clip_score, mismatched_quantile, object_scores, recognised, retrieval
from pentimento.semantics.tokenizer import learn_tokenizer
from pentimento.semantics.training import EncoderTraining, train_encoder
from pipelines._config import load_section, shipped
from pipelines._io import end_with_parent, output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import tracked_run


@dataclass(frozen=True)
class EncoderConfig:
    """One encoder: trained here, or published."""

    published: str | None
    """`base` for the one that ships, or the local folder of a CLIP model in the published layout; either is used
    unchanged. Null trains one.
    """
    shape: EncoderShape
    training: EncoderTraining


@dataclass(frozen=True)
class TrainSemantics:
    """Section `train_semantics` of params.yaml."""

    merges: int
    """Maximum number of merges of the tokenizer."""
    caption_tokens: int
    views_seed: int
    """Of the drawings that both encoders learn from."""
    test_scenes: int
    """Maximum number of test scenes in the scores."""
    retrieval_candidates: int
    """Number of captions in each retrieval task; one of them is the picture's own."""
    encoders: dict[str, EncoderConfig]
    """`main` and `judge`: the encoder that guides a plan must not score it."""

    def __post_init__(self) -> None:
        at_least(self, 0, "merges", "views_seed")
        at_least(self, 4, "caption_tokens")
        above_zero(self, "test_scenes")
        at_least(self, 2, "retrieval_candidates")
        if set(self.encoders) != {"main", "judge"}:
            raise ValueError(f"encoders are {', '.join(self.encoders) or 'none'}; give main and judge.")
        one, other = self.encoders["main"], self.encoders["judge"]
        if (one.published, one.shape, one.training.seed) == (other.published, other.shape, other.training.seed):
            raise ValueError("main and judge are the same; give the judge another seed and another shape.")


def main(arguments: argparse.Namespace) -> None:
    """Write `--semantics` and `--judge`: each a model in the published layout, with metrics.json and curve.json."""
    config = load_section(arguments.params, "train_semantics", TrainSemantics)
    folders = {
        name: shipped(config.encoders[name].published, arguments.base, part)
        for name, part in (("main", "semantics"), ("judge", "judge"))
    }
    single_threaded()
    scenes = {"main": arguments.scenes, "judge": arguments.judge_scenes or arguments.scenes}
    inputs = {"scenes": arguments.scenes} | ({"judge_scenes": s} if (s := arguments.judge_scenes) else {})
    with (
        tracked_run("train_semantics", None, asdict(config), inputs) as run,
        output_folder(arguments.semantics) as main_out,
        output_folder(arguments.judge) as judge_out,
    ):
        outs = {"main": main_out, "judge": judge_out}
        # Each process creates its own examples, which takes no longer than creating them once on one core.
        with ProcessPoolExecutor(len(outs), multiprocessing.get_context("spawn"), end_with_parent) as pool:
            begun = {
                name: pool.submit(_train, name, config, scenes[name], folders[name], out) for name, out in outs.items()
            }
            results = {name: future.result() for name, future in begun.items()}
        for name, (metrics, curve) in results.items():
            for step, loss in zip(curve["step"], curve["loss"], strict=True):
                run.log(f"{name}.loss", loss, int(step))
            run.log_metrics({name: metrics})


def _train(
    name: str, config: TrainSemantics, scenes: Path, published: Path | None, out: Path
) -> tuple[dict[str, Any], dict[str, list[float]]]:
    """Train one encoder in a separate process, or read the published one; write it with its scores and its curve into
    ``out``.
    """
    single_threaded()
    rows = _splits(scenes)
    test = _first(rows["test"], config.test_scenes)
    views = torch.from_numpy(drawn_views(test.images, config.views_seed + 1)).permute(1, 0, 4, 2, 3).float() / 255
    kinds = sorted(set(kinds_of(rows["train"])) | set(kinds_of(rows["test"])))
    encoder, curve = _encoder(config.encoders[name], config, published, rows["train"])
    metrics = evaluate(encoder, test, views, kinds, config.retrieval_candidates)
    metrics["parameters"] = sum(p.numel() for p in encoder.model.parameters())
    metrics["digest"] = encoder.digest
    encoder.save(out)
    write_json(out / "metrics.json", metrics)
    write_json(out / "curve.json", curve)
    return metrics, curve


def evaluate(encoder: Encoder, test: Captioned, views: Tensor, kinds: list[str], among: int) -> dict[str, Any]:
    """Return scores on held-out compositions by view, each with chance or the strongest trivial answer.

    Args:
        views: [V, N, 3, H, W] by ``VIEWS``.
    """
    metrics: dict[str, Any] = {"scenes": len(test.images)}
    for number, view in enumerate(VIEWS):
        # The second wording names no colour, which a black drawing cannot show.
        captions = [texts[min(1, len(texts) - 1)] if is_black(number) else texts[0] for texts in test.captions]
        images = views[number]
        scores: dict[str, Any] = {"retrieval": _finite(retrieval(encoder, images, captions, among=among, seed=0))}
        if kinds and any(test.objects):
            answers = recognised(object_scores(encoder, images, kinds), kinds, test.objects)
            scores["objects"] = {
                "recognised": float(np.mean([answer for row in answers for answer in row])),
                "chance": float(np.mean([len(row) / len(kinds) for row in test.objects for _ in row])),
            }
        scores["clip_score"] = {
            "own": float(clip_score(encoder, images, captions).mean()),
            "mismatched_median": mismatched_quantile(encoder, images, captions, q=0.5, seed=0),
            "mismatched_95": mismatched_quantile(encoder, images, captions, q=0.95, seed=0),
        }
        metrics[view] = scores
    return metrics


def _finite(values: dict[str, float]) -> dict[str, float]:
    """Return the finite values; too few scenes leave others unknown."""
    return {name: value for name, value in values.items() if np.isfinite(value)}


def _encoder(
    entry: EncoderConfig, config: TrainSemantics, published: Path | None, rows: Captioned
) -> tuple[Encoder, dict[str, list[float]]]:
    """Return the encoder and its curve, which is empty for a published one."""
    curve: dict[str, list[float]] = {"step": [], "loss": []}
    if published is not None:
        return Encoder.load(published), curve

    def log(what: str, value: float, step: int) -> None:
        curve["step"].append(step)
        curve["loss"].append(value)

    texts = [text for captions in rows.captions for text in captions]
    tokenizer = learn_tokenizer(texts, config.merges, config.caption_tokens)
    known = examples(rows, tokenizer, config.views_seed)
    return train_encoder(known, tokenizer, entry.shape, config=entry.training, log=log), curve


def _splits(folder: Path) -> dict[str, Captioned]:
    table = read_table(folder, CONTRACT).table
    if "split" not in table.column_names:
        raise ContractError(f"The scenes in {folder} have no column split; make them by build_scenes.")
    parts = {split: table.filter(pc.equal(table["split"], split)) for split in ("train", "test")}
    for split, part in parts.items():
        if part.num_rows < 2:
            raise ContractError(f"The scenes in {folder} hold {part.num_rows} of split {split}; at least 2 are needed.")
    return {split: captioned(part) for split, part in parts.items()}


def _first(rows: Captioned, count: int) -> Captioned:
    return Captioned(
        rows.images[:count], rows.captions[:count], rows.objects[:count], rows.colors[:count], rows.regions[:count]
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="train_semantics", description=__doc__)
    parser.add_argument("--params", type=Path, default=Path("params.yaml"))
    parser.add_argument("--scenes", required=True, type=Path)
    parser.add_argument("--judge-scenes", type=Path, help="the judge learns from these instead")
    parser.add_argument("--base", type=Path, help="folder of the base that ships, for `published: base`")
    parser.add_argument("--semantics", required=True, type=Path, help="where the main encoder goes")
    parser.add_argument("--judge", required=True, type=Path, help="where the judge goes")
    stage_main(main, parser)
