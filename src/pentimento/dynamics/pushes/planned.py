"""A push model as the sculptor asks for it: ``planning.pushes.model.PushModel``, its gradients by autograd."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from pentimento.dynamics.pushes.param2deform import Param2Deform
from pentimento.dynamics.pushes.pose import Crop, to_canvas, to_pose
from pentimento.dynamics.pushes.push_model import PushModel
from pentimento.planning.pushes.rollout import Array, FloatArray, Pull

_AT_ONCE = 64


class TorchClay:
    """Networks of one context before one window; what they foretell is averaged."""

    def __init__(self, networks: tuple[Param2Deform, ...], crop: Crop, context: int, window_m: FloatArray, tool: str):
        self._networks, self._crop, self._context = networks, crop, context
        self._window_m, self._tool = np.asarray(window_m, dtype=np.float64), tool

    @property
    def window_m(self) -> FloatArray:
        """[4], canvas frame: what the heights cover."""
        return self._window_m

    @property
    def end_effector(self) -> str:
        """The one of the context."""
        return self._tool

    def after(self, height_m: Array, actions: FloatArray) -> Array:
        """See ``planning.pushes.model.PushModel``."""
        height = torch.from_numpy(np.ascontiguousarray(height_m, dtype=np.float32))
        made = np.empty((len(actions), *height_m.shape), dtype=np.float32)
        with torch.no_grad():
            for first in range(0, len(actions), _AT_ONCE):
                some = torch.from_numpy(np.asarray(actions[first : first + _AT_ONCE], dtype=np.float32))
                made[first : first + _AT_ONCE] = self.predicted(height.expand(len(some), -1, -1), some).numpy()
        return made

    def step(self, height_m: Array, action: FloatArray) -> tuple[Array, Pull]:
        """See ``planning.pushes.model.PushModel``."""
        height = torch.from_numpy(np.array(height_m, dtype=np.float32)).requires_grad_(True)
        given = torch.from_numpy(np.array(action, dtype=np.float32)).requires_grad_(True)
        with torch.enable_grad():
            made = self.predicted(height[None], given[None])[0]

        def pull(cotangent: Array) -> tuple[Array, FloatArray]:
            back = torch.from_numpy(np.ascontiguousarray(cotangent, dtype=np.float32))
            to_height, to_action = torch.autograd.grad(made, (height, given), back)
            return to_height.numpy(), to_action.numpy().astype(np.float64)

        return made.detach().numpy(), pull

    def predicted(self, height: Tensor, action: Tensor) -> Tensor:
        """Heights [B, H, W] after actions [B, 5] upon heights [B, H, W]: what a robot carries, exported."""
        window = torch.tensor(self._window_m, dtype=torch.float32).expand(action.shape[0], 4)
        seen = to_pose(height, window, action, self._crop)
        contexts = torch.full_like(action[:, 0], self._context, dtype=torch.int64)
        changes = [network(seen, action[:, 3], action[:, 4], contexts) for network in self._networks]
        change = torch.stack(changes).mean(0)
        return height + to_canvas(change, window, action, (height.shape[1], height.shape[2]), self._crop)


def planned_clay(model: PushModel, window_m: FloatArray, context: int = 0) -> TorchClay:
    """The members' mean in one context."""
    return TorchClay(_networks(model), model.facts.crop, context, window_m, model.facts.contexts[context][1])


def planned_members(model: PushModel, window_m: FloatArray, context: int = 0) -> tuple[TorchClay, ...]:
    """Each member alone: where they differ, the model does not know."""
    crop, tool = model.facts.crop, model.facts.contexts[context][1]
    return tuple(TorchClay((network,), crop, context, window_m, tool) for network in _networks(model))


def _networks(model: PushModel) -> tuple[Param2Deform, ...]:
    return tuple(member for member in model.members if isinstance(member, Param2Deform))
