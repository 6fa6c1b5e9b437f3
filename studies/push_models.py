"""Prediction errors of push models, in hidden worlds of clay: `python -m studies.push_models`.

Each world is drawn by its seed: foam, dough and sand whose strengths and constants differ from the bundled files. The
robot makes 400 designed pushes in each (24 actions three times); a quarter of the actions is held out. Each part of
the study is stored in `data/studies/push_models/` when it ends, and a stored part is not repeated. The page
`docs/push_models.md` is written from the stored parts (`--parts 0` only writes it).
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import torch

from pentimento.collection.pushes import PushCollectionConfig, collect_pushes
from pentimento.contracts.errors import ContractError
from pentimento.contracts.pushes import CONTRACT
from pentimento.contracts.tables import read_table, write_table
from pentimento.dynamics.pushes.evaluation import predict, score, scores
from pentimento.dynamics.pushes.measured import PushSamples, load_pushes
from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import PoseSamples, in_pose
from pentimento.dynamics.pushes.push_model import PushModel, read_push_model, write_push_model
from pentimento.dynamics.pushes.training import TrainingConfig, crop_for, loss, split_by_action, train
from pentimento.robots.tools import load_end_effector
from pentimento.robots.virtual import VirtualSculptingRobot
from pentimento.studio.clay.studio import ClayStudio
from pentimento.studio.clay.world import ClayWorld, load_clay_world
from studies.push_models_page import page
from studies.push_plough import above_start, fit_plough, ploughed
from studies.push_unet import after_unet, fit_unet

MATERIALS = ("foam", "dough", "sand")
SIZES = (25, 50, 100, 200)
FEW = 20
REGION = (0.025, 0.008)
"""Max length and depth of the training region in the part `outside`, metres."""
PASSES = 7200
"""Training pushes, with repetition: small sets have more epochs, so that all models have as many steps."""
LONGER, BEFORE_ADAPTING = 5 / 3, 1.25
"""Factors on `PASSES`: for each material of the conditioned model (one network learns all three), and for the whole
training of a model that is fine-tuned on another material."""
DOCS = Path("docs/push_models.md")
CONFIG = TrainingConfig(
    pixels_per_m=math.inf,
    side_px=64, behind_m=0.03, channels=16, members=1, epochs=1, batch=16, learning_rate=4e-3, visual_weight=1.0,
    held_out=0.25, seed=0,
)  # fmt: skip
_STEPS, _RATE, _RATE_OF_ALL = 150, 0.01, 3e-4
"""Steps of each phase of the adaptation, and its learning rates: of the context's parameters, and of all."""
_BATCH = 20
"""Pushes per adaptation step."""
_CONTEXT_PARAMETERS = ("tool", "context", "apart")
"""Parameters of the network with a row for each context."""


def drawn_world(material: str, seed: int) -> ClayWorld:
    """A bundled material whose constants are off by about a fifth, and each effect's strength by up to a half."""
    world = load_clay_world(material)
    rng = np.random.default_rng([seed, MATERIALS.index(material)])
    names = ("hardness_pa", "rim_m", "rebound", "crush", "hardening", "repose")
    constants = {name: getattr(world.material, name) * float(np.exp(0.2 * rng.uniform(-1, 1))) for name in names}
    constants["rebound"], constants["crush"] = (min(constants[name], 0.9) for name in ("rebound", "crush"))
    strengths = {f.name: getattr(world.effects, f.name) * float(rng.uniform(0.5, 1.5)) for f in fields(world.effects)}
    return replace(world, material=replace(world.material, **constants), effects=replace(world.effects, **strengths))


class World:
    """The parts of the study in one drawn world, each stored in its file."""

    def __init__(self, out: Path, seed: int) -> None:
        self.seed, self.folder = seed, out / f"world_{seed:02d}"
        self.folder.mkdir(parents=True, exist_ok=True)
        self._loaded: dict[str, tuple[PushSamples, PushSamples]] = {}

    def parts(self) -> dict[str, Callable[[], dict[str, Any]]]:
        """The function of each part, by name and in order; a part may read those before it."""
        made: dict[str, Callable[[], dict[str, Any]]] = {}
        for material in MATERIALS:
            made[f"collect_{material}"] = lambda m=material: self.collect(m, "ball")
        for material in MATERIALS:
            made[f"both_{material}"] = lambda m=material: self.single(m, "both", 1.0)
        for material in MATERIALS:
            made[f"plough_{material}"] = lambda m=material: self.plough(m)
        for material in MATERIALS:
            made[f"unet_{material}"] = lambda m=material: self.unet(m)
        for material in MATERIALS:
            made[f"3d_{material}"] = lambda m=material: self.single(m, "3d", 0.0)
        made["transfer"] = self.transfer
        made["conditioned"] = self.conditioned
        for material in MATERIALS:
            made[f"unseen_{material}"] = lambda m=material: self.unseen(m)
        made["longer"] = self.longer
        made["collect_pinch"] = lambda: self.collect("pinch", "gripper")
        made["both_pinch"] = lambda: self.single("pinch", "both", 1.0)
        for material in MATERIALS:
            for size in SIZES:
                made[f"size_{size}_{material}"] = lambda m=material, n=size: self.smaller(m, n)
            made[f"outside_{material}"] = lambda m=material: self.outside(m)
        return made

    def collect(self, name: str, tool: str) -> dict[str, Any]:
        material = "foam" if name == "pinch" else name
        config = PushCollectionConfig(400, 24, 3, (1, 5), 0.5, 0.02, 128, self.seed)
        robot = VirtualSculptingRobot(ClayStudio(drawn_world(material, self.seed), self.seed))
        rows = collect_pushes(robot, load_end_effector(tool), material, config, lambda *_: None)
        write_table(self.folder / name, pa.Table.from_pylist(rows), CONTRACT, f"Pushes of world {self.seed}.")
        return {"rows": len(rows)}

    def samples(self, name: str) -> tuple[PushSamples, PushSamples]:
        """(training, held-out)."""
        if name not in self._loaded:
            measured, _ = load_pushes(read_table(self.folder / name, CONTRACT).table)
            self._loaded[name] = split_by_action(measured, CONFIG.held_out, 0)
        return self._loaded[name]

    def model(self, name: str) -> PushModel:
        return read_push_model(self.folder / "weights" / name)

    def fit(
        self, name: str, trained_on: dict[str, PushSamples], visual_weight: float = 1.0, passes: float = 1.0
    ) -> PushModel:
        """Train one model on the contexts of these names and store it, or read it if it is stored."""
        target = self.folder / "weights" / name
        if (target / "weights.safetensors").exists():
            return read_push_model(target)
        parts = list(trained_on.values())
        config = replace(CONFIG, epochs=_epochs(parts, passes), visual_weight=visual_weight)
        crop = crop_for(parts[0], config)
        kind: Literal["push", "pinch"] = "push" if parts[0].kind[0] == "push" else "pinch"
        contexts = [(key, str(part.tool[0])) for key, part in trained_on.items()]
        model = train(
            together([in_pose(part, crop) for part in parts]),
            kind,
            contexts,
            crop=crop,
            config=config,
            log=lambda *_: None,
        )
        target.mkdir(parents=True, exist_ok=True)
        write_push_model(model, target)
        return model

    def single(self, name: str, losses: str, visual_weight: float) -> dict[str, Any]:
        training, held_out = self.samples(name)
        model = self.fit(f"{losses}_{name}", {name: training}, visual_weight)
        return scores(model, training, held_out, all_samples=held_out)

    def plough(self, name: str) -> dict[str, Any]:
        training, held_out = self.samples(name)
        crop = crop_for(training, CONFIG)
        plough = fit_plough(above_start(training, crop), crop)
        return {"held_out": asdict(score(ploughed(plough, held_out, crop), held_out, crop)), "fitted": plough._asdict()}

    def unet(self, name: str) -> dict[str, Any]:
        training, held_out = self.samples(name)
        network = fit_unet(training, replace(CONFIG, epochs=_epochs([training])))
        return {"held_out": asdict(score(after_unet(network, held_out), held_out, crop_for(training, CONFIG)))}

    def transfer(self) -> dict[str, Any]:
        """L_3D of each material's model on each material."""
        models = {name: self.model(f"both_{name}") for name in MATERIALS}
        return {
            on: {name: self._error(model, self.samples(on)[1]) for name, model in models.items()} for on in MATERIALS
        }

    def conditioned(self) -> dict[str, Any]:
        every = {name: self.samples(name)[0] for name in MATERIALS}
        model = self.fit("conditioned", every, passes=LONGER * len(MATERIALS))
        return {name: self._error(model, self.samples(name)[1], k) for k, name in enumerate(MATERIALS)}

    def longer(self) -> dict[str, Any]:
        """L_3D of each material's own model, trained with as many passes as the conditioned model."""
        models = {name: self.fit(f"longer_{name}", {name: self.samples(name)[0]}, passes=LONGER) for name in MATERIALS}
        return {name: self._error(model, self.samples(name)[1]) for name, model in models.items()}

    def unseen(self, name: str) -> dict[str, Any]:
        """Errors of a model of the two others, fine-tuned on a few pushes, and of a model of those few only."""
        others = {other: self.samples(other)[0] for other in MATERIALS if other != name}
        training, held_out = self.samples(name)
        few = training.pick(_some(training, FEW, self.seed))
        base = self.fit(f"without_{name}", others, passes=BEFORE_ADAPTING)
        own = adapted(base, in_pose(few, base.facts.crop), (name, "ball"), 1.0, 0)
        alone = self.fit(f"few_{name}", {name: few})
        return {
            "adapted": self._error(own, held_out),
            "alone": self._error(alone, held_out),
            "unadapted": min(self._error(base, held_out, k) for k in range(len(others))),
        }

    def smaller(self, name: str, size: int) -> dict[str, Any]:
        training, held_out = self.samples(name)
        model = self.fit(f"size_{size}_{name}", {name: training.pick(_some(training, size, self.seed))})
        return asdict(score(predict(model, held_out), held_out, model.facts.crop))

    def outside(self, name: str) -> dict[str, Any]:
        """Errors of a model of short and shallow pushes, inside and outside its training region."""
        training, held_out = self.samples(name)
        near, apart = (_within(part) for part in (training, held_out))
        model = self.fit(f"outside_{name}", {name: training.pick(near)})
        return {
            "within": self._error(model, held_out.pick(apart)),
            "beyond": self._error(model, held_out.pick(~apart)),
            "beyond_by_all": self._error(self.model(f"both_{name}"), held_out.pick(~apart)),
        }

    @staticmethod
    def _error(model: PushModel, samples: PushSamples, context: int = 0) -> float:
        return score(predict(model, samples, context), samples, model.facts.crop).l_3d_mm2


def _epochs(parts: Sequence[PushSamples], passes: float = 1.0) -> int:
    """Epochs for ``passes`` times ``PASSES`` training pushes from these sets."""
    return math.ceil(PASSES * passes / sum(len(part.before) for part in parts))


def _within(samples: PushSamples) -> np.ndarray:
    """[N] which pushes are short and shallow."""
    return (samples.action[:, 3] < REGION[0]) & (samples.action[:, 4] < REGION[1])


def _some(samples: PushSamples, size: int, seed: int) -> np.ndarray:
    """[size] rows of a small training set; nested: a larger set contains the smaller ones."""
    return np.sort(np.random.default_rng(seed).permutation(len(samples.before))[:size])


def together(parts: Sequence[PoseSamples]) -> PoseSamples:
    """Pushes of several contexts as one set; the k-th part belongs to context k."""
    columns = list(zip(*parts, strict=True))
    contexts = torch.cat([torch.full_like(part.context, number) for number, part in enumerate(parts)])
    state, change, known, length, depth = (torch.cat(column) for column in columns[:5])
    return PoseSamples(state, change, known, length, depth, contexts)


def adapted(model: PushModel, few: PoseSamples, context: tuple[str, str], visual_weight: float, seed: int) -> PushModel:
    """A model of one new context, from a few pushes in it.

    It starts from the trained context that predicts them best. Then the context's parameters and the last layer are
    fitted, and finally all parameters at a low rate, because another material differs in more than its context.

    Raises:
        ContractError: there is no push.
    """
    if not len(few.state):
        raise ContractError("There are no pushes to adapt to; record some in the new material.")
    pixels_per_m = model.facts.crop.pixels_per_m
    facts = replace(
        model.facts,
        contexts=(context,),
        longest_m=float(few.length_m.max()),
        deepest_m=float(few.depth_m.max()),
    )
    result = PushModel(facts)
    generator = torch.Generator().manual_seed(seed)
    for old, new in zip(model.members, result.members, strict=True):
        assert isinstance(old, Param2Deform) and isinstance(new, Param2Deform)
        weights = old.state_dict()
        best = _nearest(old, few, pixels_per_m, visual_weight)
        context_weights = {name: weights[name][best : best + 1] for name in _CONTEXT_PARAMETERS if name in weights}
        new.load_state_dict(weights | context_weights)
        _fit_context(new, few, pixels_per_m, visual_weight, generator)
    return result.eval().requires_grad_(False)


def _nearest(network: Param2Deform, few: PoseSamples, pixels_per_m: float, visual_weight: float) -> int:
    """The trained context that predicts the pushes best."""
    errors = []
    with torch.no_grad():
        for number in range(len(network.tool)):
            change = network(few.state, few.length_m, few.depth_m, torch.full_like(few.context, number))
            errors.append(float(loss(change - few.change, few.known, pixels_per_m, visual_weight=visual_weight)))
    return errors.index(min(errors))


def _fit_context(
    network: Param2Deform, few: PoseSamples, pixels_per_m: float, visual_weight: float, generator: torch.Generator
) -> None:
    few = few._replace(context=torch.zeros_like(few.context))
    context_parameters = [value for name, value in network.named_parameters() if name in _CONTEXT_PARAMETERS]
    last = list(network.merged[-1].parameters())
    steps: list[list[dict[str, Any]]] = [
        [{"params": context_parameters, "lr": _RATE}, {"params": last, "lr": _RATE / 5}],
        [{"params": list(network.parameters()), "lr": _RATE_OF_ALL}],
    ]
    for groups in steps:
        network.requires_grad_(False)
        for group in groups:
            for parameter in group["params"]:
                parameter.requires_grad_(True)
        optimizer = torch.optim.Adam(groups)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, _STEPS)
        for _ in range(_STEPS):
            some = few.pick(torch.randperm(len(few.state), generator=generator)[:_BATCH])
            some = some.mirrored(torch.rand(len(some.state), generator=generator) < 0.5)
            optimizer.zero_grad()
            change = network(some.state, some.length_m, some.depth_m, some.context)
            torch.autograd.backward(loss(change - some.change, some.known, pixels_per_m, visual_weight=visual_weight))
            optimizer.step()
            schedule.step()


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m studies.push_models", description=__doc__)
    parser.add_argument("--worlds", type=int, default=5)
    parser.add_argument("--parts", type=int, default=10**6, help="stop after so many parts that were not there")
    parser.add_argument("--out", type=Path, default=Path("data/studies/push_models"))
    args = parser.parse_args()
    torch.set_num_threads(1)
    left, seeds = args.parts, range(1, args.worlds + 1)
    found: dict[int, dict[str, Any]] = {seed: {} for seed in seeds}
    # Part by part: a study that is stopped has its first parts of all worlds.
    for name, seed in product(World(args.out, 1).parts(), seeds):
        world = World(args.out, seed)
        file = world.folder / f"{name}.json"
        if not file.exists() and left > 0:
            print(f"world {seed}: {name} …", flush=True)
            file.write_text(json.dumps(world.parts()[name](), indent=1), encoding="utf-8")
            left -= 1
        if file.exists():
            found[seed][name] = json.loads(file.read_text(encoding="utf-8"))
    DOCS.write_text(page([results for results in found.values() if results]), encoding="utf-8")


if __name__ == "__main__":
    main()
