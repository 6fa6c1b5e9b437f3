"""A trained push model: the ensemble with its crop and training ranges, as files, and as the sculptor's planner uses
it."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from pentimento.contracts.errors import ConfigError
from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import Crop, to_canvas, to_pose
from pentimento.planning.pushes.memory import FRESH, PushMemory
from pentimento.planning.pushes.rollout import Array, FloatArray, Pull, Unexplained

_SCHEMA = 1
"""Version of ``config.json``."""
_BATCH = 64
"""Actions in one forward pass."""


@dataclass(frozen=True)
class PushFacts:
    """Configuration of a push model; ``config.json``."""

    kind: Literal["push", "pinch"]
    contexts: tuple[tuple[str, str], ...]
    """Material and end-effector of each context in the training set."""
    crop: Crop
    channels: int
    longest_m: float
    """Maximum length of travel (pinch: closing) in the training set."""
    deepest_m: float
    """Maximum depth in the training set."""
    members: int
    """Networks of the ensemble, which differ in their last layer. Their mean is the prediction, their spread its
    uncertainty (``last_layers``)."""
    unexplained: Unexplained | None = None
    """What the model leaves of held-out pushes (``uncertainty``); None where that was not measured."""


class PushModel(torch.nn.Module):
    """An ensemble of networks with one crop."""

    def __init__(self, facts: PushFacts) -> None:
        super().__init__()
        self.facts = facts
        self.members = torch.nn.ModuleList(
            Param2Deform(facts.crop, facts.channels, len(facts.contexts), facts.kind == "pinch")
            for _ in range(facts.members)
        )

    def change(self, crop_m: Tensor, length_m: Tensor, depth_m: Tensor, context: Tensor) -> Tensor:
        """Change [M, B, side, side] in metres that each member predicts in the crop."""
        return torch.stack([member(crop_m, length_m, depth_m, context) for member in self.members])

    def after(self, before_m: Tensor, window_m: Tensor, action: Tensor, context: Tensor | None = None) -> Tensor:
        """Heights [B, H, W] after actions [B, 5] on heights [B, H, W] over windows [B, 4]: the members' mean.

        Without contexts [B], the first context is used.
        """
        crop = self.facts.crop
        seen = to_pose(before_m, window_m, action, crop)
        if context is None:
            context = torch.zeros(len(action), dtype=torch.int64)
        change = self.change(seen, action[:, 3], action[:, 4], context).mean(0)
        return before_m + to_canvas(change, window_m, action, shape=(before_m.shape[1], before_m.shape[2]), crop=crop)


def write_push_model(model: PushModel, folder: Path) -> None:
    """Write ``config.json`` and ``weights.safetensors`` into an existing folder."""
    config = {"schema": _SCHEMA, **asdict(model.facts)}
    (folder / "config.json").write_text(json.dumps(config, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    save_file({name: value.contiguous() for name, value in model.state_dict().items()}, folder / "weights.safetensors")


def read_push_model(folder: Path) -> PushModel:
    """The model that ``write_push_model`` wrote; its weights are frozen.

    Raises:
        ConfigError: a file is missing or invalid.
    """
    try:
        config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
        weights = load_file(folder / "weights.safetensors")
        if config.pop("schema") != _SCHEMA:
            raise ValueError("another schema")
        contexts = tuple((str(material), str(tool)) for material, tool in config.pop("contexts"))
        left = config.pop("unexplained", None)
        unexplained = None if left is None else Unexplained(**left)
        crop = Crop(**config.pop("crop"))
        model = PushModel(PushFacts(contexts=contexts, crop=crop, unexplained=unexplained, **config))
        model.load_state_dict(weights)
    except (OSError, KeyError, TypeError, ValueError, RuntimeError, SafetensorError) as error:
        raise ConfigError(
            f"{folder} holds no push model ({error}): give the weights/ of one that train_push_dynamics wrote."
        ) from error
    return model.eval().requires_grad_(False)


class AutogradClay(ABC):
    """A push model over one window in PyTorch: ``planning.pushes.rollout.PushModel``, with gradients by autograd."""

    def __init__(self, *, window_m: FloatArray, tool: str) -> None:
        self._window_m, self._tool = np.asarray(window_m, dtype=np.float64), tool

    @abstractmethod
    def heights(self, height: Tensor, action: Tensor) -> Tensor:
        """Heights [B, H, W] after actions [B, 5] on heights [B, H, W]."""

    @property
    def window_m(self) -> FloatArray:
        """[4], canvas frame: the area of the height maps."""
        return self._window_m

    @property
    def end_effector(self) -> str:
        """The end-effector whose pushes it was trained on."""
        return self._tool

    def after(self, height_m: Array, actions: FloatArray, memory: PushMemory = FRESH) -> Array:
        """See ``planning.pushes.rollout.PushModel``."""
        height = torch.from_numpy(np.ascontiguousarray(height_m, dtype=np.float32))
        result = np.empty((len(actions), *height_m.shape), dtype=np.float32)
        with torch.no_grad():
            for first in range(0, len(actions), _BATCH):
                some = torch.from_numpy(np.asarray(actions[first : first + _BATCH], dtype=np.float32))
                result[first : first + _BATCH] = self.heights(height.expand(len(some), -1, -1), some).numpy()
        return result

    def step(self, height_m: Array, action: FloatArray, memory: PushMemory = FRESH) -> tuple[Array, Pull]:
        """See ``planning.pushes.rollout.PushModel``."""
        height = torch.from_numpy(np.array(height_m, dtype=np.float32)).requires_grad_(True)
        action_tensor = torch.from_numpy(np.array(action, dtype=np.float32)).requires_grad_(True)
        with torch.enable_grad():
            result = self.heights(height[None], action_tensor[None])[0]

        def pull(cotangent: Array) -> tuple[Array, FloatArray]:
            back = torch.from_numpy(np.ascontiguousarray(cotangent, dtype=np.float32))
            to_height, to_action = torch.autograd.grad(result, (height, action_tensor), back)
            return to_height.numpy(), to_action.numpy().astype(np.float64)

        return result.detach().numpy(), pull


class TorchClay(AutogradClay):
    """Networks of one context; their predictions are averaged. They know no memory."""

    def __init__(
        self, networks: tuple[Param2Deform, ...], crop: Crop, *, context: int, window_m: FloatArray, tool: str
    ):
        super().__init__(window_m=window_m, tool=tool)
        self._networks, self._crop, self._context = networks, crop, context

    def heights(self, height: Tensor, action: Tensor) -> Tensor:
        """Heights [B, H, W] after actions [B, 5] on heights [B, H, W]; this function is exported for the robot."""
        window = torch.tensor(self._window_m, dtype=torch.float32).expand(action.shape[0], 4)
        seen = to_pose(height, window, action, self._crop)
        contexts = torch.full_like(action[:, 0], self._context, dtype=torch.int64)
        changes = [network(seen, action[:, 3], action[:, 4], contexts) for network in self._networks]
        change = torch.stack(changes).mean(0)
        return height + to_canvas(change, window, action, shape=(height.shape[1], height.shape[2]), crop=self._crop)


def planned_clay(model: PushModel, window_m: FloatArray, context: int = 0) -> TorchClay:
    """The mean of the members in one context."""
    return TorchClay(
        _networks(model), model.facts.crop, context=context, window_m=window_m, tool=model.facts.contexts[context][1]
    )


def planned_members(model: PushModel, window_m: FloatArray, context: int = 0) -> tuple[TorchClay, ...]:
    """Each member alone; their disagreement measures the model's uncertainty."""
    crop, tool = model.facts.crop, model.facts.contexts[context][1]
    return tuple(
        TorchClay((network,), crop, context=context, window_m=window_m, tool=tool) for network in _networks(model)
    )


def _networks(model: PushModel) -> tuple[Param2Deform, ...]:
    return tuple(member for member in model.members if isinstance(member, Param2Deform))
