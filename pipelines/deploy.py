"""Write a bundle with everything that the runner needs: graphs checked against PyTorch, tools, manifest."""

import argparse
import hashlib
import json
from dataclasses import asdict
from pathlib import Path

from pentimento.bundle.reader import MANIFEST, open_bundle
from pentimento.contracts.errors import ContractError
from pentimento.copainting.goal.planner import load_goal_planner
from pentimento.deploy.bundle import DeployConfig, Models, check_deployed_clays, write_bundle
from pentimento.dynamics.pushes.push_model import read_push_model
from pentimento.dynamics.strokes.extended import read_stroke_model
from pentimento.planning.pushes.analytic.correction import FILE, read_correction
from pentimento.planning.pushes.places import FILE as PLACES
from pentimento.planning.pushes.places import read_place_model
from pentimento.planning.strokes.latent import StyleDecoder, read_decoder
from pentimento.semantics.encoder import Encoder
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main
from pipelines._tracking import input_digests, tracked_run


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: the bundle."""
    config = load_section(Path("params.yaml"), "deploy", DeployConfig)
    single_threaded()
    strokes = {f"stroke_{tool}": arguments.models / f"stroke_{tool}/weights" for tool in arguments.tools}
    pushes = {f"push_{material}": arguments.models / f"push_{material}/weights" for material in arguments.materials}
    inputs = {**strokes, **pushes, "semantics": arguments.semantics, "goal": arguments.goal}
    if arguments.hands is not None:
        inputs["hands"] = arguments.hands
    with (
        tracked_run("deploy", None, asdict(config), inputs) as run,
        output_folder(arguments.out) as out,
    ):
        models = Models(
            strokes={tool: read_stroke_model(strokes[f"stroke_{tool}"]) for tool in arguments.tools},
            encoder=Encoder.load(arguments.semantics),
            encoder_folder=arguments.semantics,
            goal=load_goal_planner(arguments.goal),
            goal_folder=arguments.goal,
            pushes={material: read_push_model(pushes[f"push_{material}"]) for material in arguments.materials},
            digests=input_digests(inputs),
            corrections={
                material: read_correction(pushes[f"push_{material}"] / FILE)
                for material in arguments.materials
                if (pushes[f"push_{material}"] / FILE).is_file()
            },
            places={
                material: read_place_model(pushes[f"push_{material}"] / PLACES)
                for material in arguments.materials
                if (pushes[f"push_{material}"] / PLACES).is_file()
            },
            hands={} if arguments.hands is None else _hands(arguments.hands),
        )
        write_bundle(out, models, config)
        bundle = open_bundle(out)  # a bundle that the runner would refuse fails here
        differences = check_deployed_clays(bundle, models, config.tolerance)
        run.log_metrics(json.loads((out / "metrics.json").read_text(encoding="utf-8")) | {"push_models": differences})
        run.tag("manifest", hashlib.sha256((out / MANIFEST).read_bytes()).hexdigest())


def _hands(folder: Path) -> dict[str, StyleDecoder]:
    """Every writer's decoder in the output of train_trajvae, by the writer's name.

    Raises:
        ContractError: there is none, or one is damaged.
    """
    files = sorted((folder / "hands").glob("*.npz"))
    if not files:
        raise ContractError(f"{folder}/hands holds no hand; make them with the stage train_trajvae.")
    return {decoder.hand: decoder for decoder in map(read_decoder, files)}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="deploy", description=__doc__)
    parser.add_argument("--models", required=True, type=Path, help="folder of stroke_<tool> and push_<material>")
    parser.add_argument("--tools", required=True, nargs="+", help="whose models are there")
    parser.add_argument("--materials", nargs="*", default=[], help="whose push models are there")
    parser.add_argument("--semantics", required=True, type=Path)
    parser.add_argument("--goal", required=True, type=Path, help="the goal planner")
    parser.add_argument("--hands", type=Path, help="weights of TrajVAE, whose hands the bundle shall hold")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
