"""Image objectives as graphs: a picture to the value of the objective and its gradient.

Values are those of `semantics.objective` and `semantics.style`. Their random draws are arguments of the graphs, so the
caller draws them. Pictures that are resized for the encoder may have any size, because the resizing matrices are
arguments, too (`bundle.views`). The print objective needs no graph: its compiled code is in the lean core.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import torch
from torch import Tensor

from pentimento.bundle.manifest import MAX_CELLS, StyleFacts
from pentimento.bundle.views import random_views, resizing_matrix
from pentimento.deploy.decompositions import Resizing
from pentimento.deploy.graphs import Graph, compared, export, generator
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.objective import semantic_loss, text_loss
from pentimento.semantics.style_features import LocalFeatures, cell_grid

_EXAMPLE_PX: Final = (45, 37)  # differ from each other and every other size in the graphs
_COMPARED_PX: Final = ((64, 64), (96, 96), (50, 130), (80, 60), (33, 47))
_UNITS: Final = {
    "image": "linear light, any values",
    "target": "linear light",
    "caption": "unit vector, as the graph caption gives it",
    "views": "affine matrices, normalised coordinates; bundle.views.random_views",
    "rows": "bundle.views.resizing_matrix",
    "columns": "bundle.views.resizing_matrix",
    "loss": "1, the objective",
    "gradient": "d loss / d image",
    "tokens": "token ids, padded with the end token",
    "vector": "unit vector",
    "features": "sRGB units, see semantics.style_features",
    "partners": "features of the cells paired with them",
    "drawn": "indices of the paired cells",
}


def encoder_graphs(encoder: Encoder, views: int, tolerance: float) -> dict[str, Graph]:
    """`semantic`, `text` and `caption`, for pictures with `views` random views in addition to the plain one.

    Raises:
        ParityError: a graph does not compute what PyTorch does.
    """
    resizing = Resizing()

    def examples(name: str, size: tuple[int, int]) -> list[Tensor]:
        numbers = generator(name, size[0])
        image = torch.rand(*size, 3, generator=numbers)
        if name == "semantic":
            other = torch.rand(*size, 3, generator=numbers)
        else:
            other = torch.nn.functional.normalize(
                torch.randn(encoder.model.config.projection_dim, generator=numbers), dim=0
            )
        drawn = torch.from_numpy(random_views(views, np.random.default_rng(size)))
        matrices = [torch.from_numpy(resizing_matrix(side, encoder.image_px)) for side in size]
        return [image, other, drawn, *matrices]

    def with_gradient(
        value: Callable[[Encoder, Tensor, Tensor, Tensor], Tensor],
    ) -> Callable[..., tuple[Tensor, Tensor]]:
        def function(
            image: Tensor, other: Tensor, views: Tensor, rows: Tensor, columns: Tensor
        ) -> tuple[Tensor, Tensor]:
            resizing.rows, resizing.columns = rows, columns
            return value_and_gradient(lambda leaf: value(encoder, leaf, other, views), image)

        return function

    graphs = {}
    size = {0: "height", 1: "width"}
    for name, other, value, free in (
        ("semantic", "target", semantic_loss, size),
        ("text", "caption", text_loss, dict[int, str]()),
    ):
        function = with_gradient(value)
        exported = export(
            function,
            examples(name, _EXAMPLE_PX),
            ["image", other, "views", "rows", "columns"],
            outputs=["loss", "gradient"],
            free=[size, free, {}, {1: "height"}, {1: "width"}],
            resizing=resizing,
        )
        graphs[name] = compared(
            name, exported, function, examples=[examples(name, shape) for shape in _COMPARED_PX], units=_UNITS,
            tolerance=tolerance, models=("semantics",),
        )  # fmt: skip
    return graphs | {"caption": _caption_graph(encoder, tolerance)}


def style_graphs(name: str, shape: tuple[int, int], tolerance: float) -> tuple[StyleFacts, dict[str, Graph]]:
    """Graphs of the local features of pictures of one size, and of the distance of paired cells.

    Raises:
        ParityError: a graph does not compute what PyTorch does.
        ConfigError: the pictures are too small for local features.
    """
    network = LocalFeatures()
    cells = int(np.prod(cell_grid(torch.zeros(*shape, 3))))

    def features(image: Tensor) -> tuple[Tensor]:
        return (network(image),)

    def pull(image: Tensor, drawn: Tensor, partners: Tensor) -> tuple[Tensor, Tensor]:
        def distance(leaf: Tensor) -> Tensor:
            return torch.linalg.vector_norm(network(leaf)[drawn] - partners, dim=1).mean()

        return value_and_gradient(distance, image)

    def examples(number: int) -> list[Tensor]:
        numbers = generator(name, number)
        image, style = torch.rand(2, *shape, 3, generator=numbers)
        drawn = torch.randperm(cells, generator=numbers)[: min(cells, MAX_CELLS)]
        return [image, drawn, network(style)[drawn.flip(0)]]

    graphs = {}
    plain: Sequence[tuple[str, Callable[..., tuple[Tensor, ...]], int, list[str], list[str]]] = (
        ("features", features, 1, ["image"], ["features"]),
        ("pull", pull, 3, ["image", "drawn", "partners"], ["loss", "gradient"]),
    )
    for part, function, count, inputs, outputs in plain:
        graphs[f"{name}_{part}"] = compared(
            f"{name}_{part}",
            export(function, examples(0)[:count], inputs, outputs=outputs),
            function,
            examples=[examples(number)[:count] for number in (1, 2)],
            units=_UNITS,
            tolerance=tolerance,
            models=(),
        )
    return StyleFacts(*shape, cells), graphs


def value_and_gradient(function: Callable[[Tensor], Tensor], image: Tensor) -> tuple[Tensor, Tensor]:
    """The value of a scalar function of an image, and its gradient."""
    leaf = image.detach().requires_grad_(True)
    with torch.enable_grad():
        value = function(leaf)
    return value.detach(), torch.autograd.grad(value, leaf)[0]


def _caption_graph(encoder: Encoder, tolerance: float) -> Graph:
    length = encoder.model.config.text_config.max_position_embeddings
    end = encoder.tokenizer.eos_token_id

    def caption(tokens: Tensor) -> tuple[Tensor]:
        features = encoder.model.get_text_features(input_ids=tokens).pooler_output
        return (torch.nn.functional.normalize(features, dim=-1),)

    def examples(number: int) -> list[Tensor]:
        tokens = torch.randint(0, end - 1, (1, length), generator=generator("caption", number))
        tokens[:, 0] = encoder.tokenizer.bos_token_id
        tokens[:, 2 + number % (length - 2) :] = end
        return [tokens]

    return compared(
        "caption",
        export(caption, examples(3), ["tokens"], outputs=["vector"]),
        caption,
        examples=[examples(number) for number in (0, 1, 5, length)],
        units=_UNITS,
        tolerance=tolerance,
        models=("semantics",),
    )
