"""A trained push model: the network with its crop and what it was trained on; on the canvas, and in files."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from pentimento.contracts.errors import ConfigError
from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import Crop, to_canvas, to_pose

SCHEMA = 1


@dataclass(frozen=True)
class PushFacts:
    """What a push model is; ``config.json``."""

    kind: Literal["push", "pinch"]
    contexts: tuple[tuple[str, str], ...]
    """Material and end-effector of each context that it was trained on."""
    crop: Crop
    channels: int
    longest_m: float
    """Length of travel (pinch: closing) beyond which it has seen nothing."""
    deepest_m: float
    """Likewise, depth."""
    members: int
    """Networks trained alike from other random numbers; their mean is foretold, their spread is its doubt."""


class PushModel(torch.nn.Module):
    """An ensemble of networks in one pose."""

    def __init__(self, facts: PushFacts) -> None:
        super().__init__()
        self.facts = facts
        self.members = torch.nn.ModuleList(
            Param2Deform(facts.crop, facts.channels, len(facts.contexts), facts.kind == "pinch")
            for _ in range(facts.members)
        )

    def change(self, crop_m: Tensor, length_m: Tensor, depth_m: Tensor, context: Tensor) -> Tensor:
        """The change [M, B, side, side] in metres that each member foretells in the crop."""
        return torch.stack([member(crop_m, length_m, depth_m, context) for member in self.members])

    def after(self, before_m: Tensor, window_m: Tensor, action: Tensor, context: Tensor | None = None) -> Tensor:
        """Heights [B, H, W] after actions [B, 5] upon heights [B, H, W] over windows [B, 4], the members' mean.

        Without contexts [B], the first.
        """
        crop = self.facts.crop
        seen = to_pose(before_m, window_m, action, crop)
        if context is None:
            context = torch.zeros(len(action), dtype=torch.int64)
        change = self.change(seen, action[:, 3], action[:, 4], context).mean(0)
        return before_m + to_canvas(change, window_m, action, (before_m.shape[1], before_m.shape[2]), crop)


def write_push_model(model: PushModel, folder: Path) -> None:
    """``config.json`` and ``weights.safetensors`` into an existing folder."""
    config = {"schema": SCHEMA, **asdict(model.facts)}
    (folder / "config.json").write_text(json.dumps(config, indent=1, sort_keys=True) + "\n")
    save_file({name: value.contiguous() for name, value in model.state_dict().items()}, folder / "weights.safetensors")


def read_push_model(folder: Path) -> PushModel:
    """The model that ``write_push_model`` wrote; its weights are frozen.

    Raises:
        ConfigError: a file is missing, or says something else.
    """
    try:
        config = json.loads((folder / "config.json").read_text())
        weights = load_file(folder / "weights.safetensors")
        if config.pop("schema") != SCHEMA:
            raise ValueError("another schema")
        contexts = tuple((str(material), str(tool)) for material, tool in config.pop("contexts"))
        model = PushModel(PushFacts(contexts=contexts, crop=Crop(**config.pop("crop")), **config))
        model.load_state_dict(weights)
    except (OSError, KeyError, TypeError, ValueError, RuntimeError) as error:
        raise ConfigError(
            f"{folder} holds no push model ({error}): give the weights/ of one that train_push_dynamics wrote."
        ) from error
    return model.eval().requires_grad_(False)
