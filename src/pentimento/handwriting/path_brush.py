"""A stroke model as the planner of hands asks for it: from paths of any shape to marks, and back by autograd."""

from __future__ import annotations

from collections.abc import Callable

import torch

from pentimento.dynamics.strokes.planned import TorchBrush
from pentimento.dynamics.strokes.simulation import StrokeContext, extended_mark, full_at_most
from pentimento.planning.model import Array, Marks


class TorchPathBrush(TorchBrush):
    """A stroke model as a ``planning.latent.planner.PathBrush``, and a ``planning.model.Brush`` besides."""

    def path_marks(
        self, paths: Array, color: Array, inherited: dict[str, Array]
    ) -> tuple[Marks, Callable[[Marks], Array]]:
        """See ``planning.latent.planner.PathBrush``. Times are constants for the gradient; it may be gone back once."""
        path = torch.tensor(paths, requires_grad=True)
        columns = {name: torch.tensor(inherited[name])[None] for name in self.fitted}
        with torch.enable_grad():
            context = StrokeContext(path[None], columns)
            mark = full_at_most(extended_mark(self.model.mark(), self.model.mechanisms, context))
            paint, pickup = torch.tensor(color)[None], None
            for mechanism in self.model.mechanisms:
                paint, pickup = mechanism.composite(paint, pickup, context)
            fields = [values[0] for values in (*mark, paint)]
            wet = None if pickup is None else pickup[0]

        def pull(cotangent: Marks) -> Array:
            pairs = [
                (field, torch.from_numpy(given))
                for field, given in zip((*fields, wet), cotangent, strict=True)
                if field is not None and field.requires_grad and given is not None
            ]
            outputs, cotangents = zip(*pairs, strict=True)
            return torch.autograd.grad(outputs, path, cotangents)[0].numpy()

        points, radius, density, softness, color_left = (f.detach().contiguous().numpy() for f in fields)
        picked = None if wet is None else wet.detach().contiguous().numpy()
        return Marks(points, radius, density, softness, color_left, picked), pull
