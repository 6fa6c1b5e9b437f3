"""Train TrajVAE on all sessions but each writer's last, and fine-tune it on a few strokes of that one."""

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pentimento.contracts.demonstrations import CONTRACT
from pentimento.contracts.errors import ContractError
from pentimento.contracts.images import write_png
from pentimento.contracts.ranges import at_least
from pentimento.contracts.tables import read_table
from pentimento.handwriting.demonstrated import Demonstrated, demonstrated, split_last_session
from pentimento.handwriting.evaluation import mean_stroke_mm, nearest_mm, nearest_of_same_hand, reconstruction_mm
from pentimento.handwriting.figures import drawn_map, flat_map, sheet
from pentimento.handwriting.training import Adapted, TrajVAEConfig, adapt, pretrain
from pentimento.handwriting.trajvae import Strokes, TrajVAE, decoder_of, generic_decoder
from pentimento.planning.strokes.latent import StyleDecoder, write_decoder
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main, write_json
from pipelines._tracking import Run, tracked_run

_SAMPLES = 24


@dataclass(frozen=True)
class TrainTrajVAE:
    """Section `train_trajvae` of params.yaml."""

    few_shot_strokes: int
    """Strokes of a writer's last session for fine-tuning (thesis 5.3.3: fewer than 20)."""
    mapped_strokes: int
    """Maximum number of strokes in the map of the latent space."""
    model: TrajVAEConfig

    def __post_init__(self) -> None:
        at_least(self, 2, "few_shot_strokes", "mapped_strokes")


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: a decoder for each writer and a generic one, pictures of samples and latents, metrics.json,
    card.md.
    """
    config = load_section(Path("params.yaml"), "train_trajvae", TrainTrajVAE)
    single_threaded()
    with (
        tracked_run("train_trajvae", None, asdict(config), {"demonstrations": arguments.demonstrations}) as run,
        output_folder(arguments.out) as out,
    ):
        checked = read_table(arguments.demonstrations, CONTRACT)
        learned, held_out = split_last_session(demonstrated(checked.table, config.model.points))
        model = pretrain(learned.strokes, config.model, run.log_under("pretraining"))
        (out / "hands").mkdir()
        write_decoder(out / "nobody.npz", generic_decoder(model))
        metrics: dict[str, Any] = {"strokes": {"learned": len(learned.hand), "quarantined": len(checked.quarantined)}}
        pictures, made = [], "# How each writer's decoder was made\n\n"
        for hand in learned.hands:
            decoder, metrics[hand], sentence = _adapted(
                model, learned.strokes, held_out.of(hand), hand=hand, config=config, run=run
            )
            write_decoder(out / "hands" / f"{hand}.npz", decoder)
            made += sentence
            samples = decoder.sample(_SAMPLES, np.random.default_rng([config.model.seed, 31]))
            pictures += list(decoder.decode(samples)[0].astype(np.float64))
        write_png(out / "samples.png", sheet(pictures))
        metrics["map"] = _map(model, learned, config, out)
        write_json(out / "metrics.json", metrics)
        (out / "card.md").write_text(made, encoding="utf-8")
        run.log_metrics(metrics)
        for name in ("samples.png", "latent_map.png"):
            run.log_picture(out / name)


def _adapted(
    model: TrajVAE, known: Strokes, session: Demonstrated, *, hand: str, config: TrainTrajVAE, run: Run
) -> tuple[StyleDecoder, dict[str, float], str]:
    """Return a writer's decoder, errors (mm), and how it was made.

    It is adapted to the first strokes of an unseen session; the errors are those on the rest.
    """
    count, few_shot = len(session.hand), config.few_shot_strokes
    if count <= few_shot:
        raise ContractError(
            f"The last session of the hand {hand} has {count} strokes; more than train_trajvae.few_shot_strokes = "
            f"{few_shot} are needed, so that some are left to measure with."
        )
    few, rest = (session.strokes.pick(index) for index in (torch.arange(few_shot), torch.arange(few_shot, count)))
    own = adapt(model, few, known, config.model, run.log_under(hand))
    errors = {
        "pretrained": reconstruction_mm(model, rest),
        "fine_tuned": reconstruction_mm(own.model, rest),
        "nearest_demonstration": nearest_mm(few, rest),
        "mean_stroke": mean_stroke_mm(few, rest),
        "fine_tuning_steps": own.steps,
    }
    return decoder_of(own.model, few, hand), errors, _sentence(hand, own, config)


def _sentence(hand: str, own: Adapted, config: TrainTrajVAE) -> str:
    """Return how a writer's decoder was made, as an entry of the card."""
    gain = f"{own.gain_mm[0]:+.3f} ± {own.gain_mm[1]:.3f} mm (mean and standard error)"
    if own.steps == 0:
        return (
            f"- **{hand}**: the pretrained weights are kept. Fine-tuning on {config.few_shot_strokes} strokes is not "
            f"surely better on strokes that were held out of them: their error would fall by {gain}.\n"
        )
    return (
        f"- **{hand}**: fine-tuned on {config.few_shot_strokes} strokes for {own.steps} of "
        f"{config.model.fine_tuning.steps} steps. The error on strokes that were held out of them falls by {gain}.\n"
    )


def _map(model: TrajVAE, learned: Demonstrated, config: TrainTrajVAE, out: Path) -> dict[str, float]:
    """Draw the map; return how well latents separate writers, beside raw coordinates and chance."""
    every = max(-(-len(learned.hand) // config.mapped_strokes), 1)
    shown = learned.pick(np.arange(0, len(learned.hand), every))
    with torch.no_grad():
        latents = model.encode(shown.strokes)[0].double().numpy()
    paths = shown.strokes.xy_m.double().numpy()
    write_png(out / "latent_map.png", drawn_map(flat_map(latents, config.model.seed), paths, shown.hand))
    shares = [shown.hand.count(hand) / len(shown.hand) for hand in shown.hands]
    return {
        "nearest_of_same_hand": nearest_of_same_hand(latents, shown.hand),
        "nearest_of_same_hand_by_coordinates": nearest_of_same_hand(paths.reshape(len(paths), -1), shown.hand),
        "chance": float(np.square(shares).sum()),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="train_trajvae", description=__doc__)
    parser.add_argument("--demonstrations", required=True, type=Path)
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
