"""Image objectives as graphs: a picture to the objective's value and its gradient in the picture.

Values are as in ``semantics.objective`` and ``semantics.style``; what those draw at random is an argument here,
so that the runner draws it. Pictures may have any size where they are resized for the encoder, since the matrices
for that are arguments, too (``bundle.views``). The print objective is no graph: its compiled code is the lean core's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import affine_grid, grid_sample, mse_loss

from pentimento.bundle.manifest import MAX_CELLS, StyleFacts
from pentimento.bundle.views import random_views, resizing_matrix
from pentimento.deploy.decompositions import Resizing
from pentimento.deploy.graphs import Graph, compared, export, generator
from pentimento.dynamics.strokes.photometry import linear_to_srgb
from pentimento.semantics.encoder import Encoder
from pentimento.semantics.style_features import LocalFeatures, cell_grid

_EXAMPLE_PX = (45, 37)  # sizes unlike each other and unlike any other size in the graphs
_COMPARED_PX = ((64, 64), (96, 96), (50, 130), (80, 60), (33, 47))
_UNITS = {
    "image": "linear light, any values",
    "target": "linear light",
    "caption": "unit vector, as the graph caption gives it",
    "views": "affine matrices, normalised coordinates; bundle.views.random_views",
    "rows": "bundle.views.resizing_matrix",
    "columns": "bundle.views.resizing_matrix",
    "loss": "1, the objective",
    "gradient": "d loss / d image",
    "tokens": "token numbers, filled up with ends",
    "vector": "unit vector",
    "features": "sRGB units, see objectives.features",
    "partners": "features of the cells that they are paired with",
    "drawn": "which cells are paired",
}


def semantic_value(encoder: Encoder, image: Tensor, target: Tensor, views: Tensor) -> Tensor:
    """The semantic objective (4.4) of an image and a target, [H, W, 3] in linear light, seen by views [V, 2, 3] too."""
    pair = _seen(torch.cat([_as_batch(image), _as_batch(target)]), views)
    features = encoder.patch_features(pair)
    half = 1 + len(views)
    return mse_loss(features[:half], features[half:].detach())


def text_value(encoder: Encoder, image: Tensor, caption: Tensor, views: Tensor) -> Tensor:
    """The text objective (4.1) of an image [H, W, 3] in linear light and a caption's vector [D], likewise."""
    return 1 - (encoder.embed_images(_seen(_as_batch(image), views)) @ caption).mean()


def encoder_graphs(encoder: Encoder, views: int, tolerance: float) -> dict[str, Graph]:
    """``semantic``, ``text`` and ``caption``, of pictures with ``views`` beside the plain one.

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

    def sloped(value: Callable[[Encoder, Tensor, Tensor, Tensor], Tensor]) -> Callable[..., tuple[Tensor, Tensor]]:
        def function(
            image: Tensor, other: Tensor, views: Tensor, rows: Tensor, columns: Tensor
        ) -> tuple[Tensor, Tensor]:
            resizing.rows, resizing.columns = rows, columns
            return value_and_gradient(lambda leaf: value(encoder, leaf, other, views), image)

        return function

    graphs = {}
    size = {0: "height", 1: "width"}
    for name, other, value, free in (
        ("semantic", "target", semantic_value, size),
        ("text", "caption", text_value, dict[int, str]()),
    ):
        function = sloped(value)
        model = export(
            function,
            examples(name, _EXAMPLE_PX),
            ["image", other, "views", "rows", "columns"],
            ["loss", "gradient"],
            [size, free, {}, {1: "height"}, {1: "width"}],
            resizing,
        )
        compare = [examples(name, shape) for shape in _COMPARED_PX]
        graphs[name] = compared(name, model, function, compare, _UNITS, tolerance, ("semantics",))
    return graphs | {"caption": _caption_graph(encoder, tolerance)}


def style_graphs(name: str, shape: tuple[int, int], tolerance: float) -> tuple[StyleFacts, dict[str, Graph]]:
    """The style objective's local features of pictures of one size, and the distance of paired cells.

    Raises:
        ParityError: a graph does not compute what PyTorch does.
        ConfigError: the pictures are too small for local features.
    """
    network = LocalFeatures()
    cells = int(np.prod(cell_grid(torch.zeros(*shape, 3))))

    def features(image: Tensor) -> tuple[Tensor]:
        return (network(image),)

    def pull(image: Tensor, drawn: Tensor, partners: Tensor) -> tuple[Tensor, Tensor]:
        def way(leaf: Tensor) -> Tensor:
            return torch.linalg.vector_norm(network(leaf)[drawn] - partners, dim=1).mean()

        return value_and_gradient(way, image)

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
        model = export(function, examples(0)[:count], inputs, outputs)
        compare = [examples(number)[:count] for number in (1, 2)]
        graphs[f"{name}_{part}"] = compared(f"{name}_{part}", model, function, compare, _UNITS, tolerance, ())
    return StyleFacts(*shape, cells), graphs


def value_and_gradient(function: Callable[[Tensor], Tensor], image: Tensor) -> tuple[Tensor, Tensor]:
    """A scalar function of an image, and its gradient there."""
    leaf = image.detach().requires_grad_(True)
    with torch.enable_grad():
        value = function(leaf)
    return value.detach(), torch.autograd.grad(value, leaf)[0]


def _caption_graph(encoder: Encoder, tolerance: float) -> Graph:
    length = encoder.model.config.text_config.max_position_embeddings
    end = encoder.tokenizer.eos_token_id

    def caption(tokens: Tensor) -> tuple[Tensor]:
        found = encoder.model.get_text_features(input_ids=tokens).pooler_output
        return (torch.nn.functional.normalize(found, dim=-1),)

    def examples(number: int) -> list[Tensor]:
        tokens = torch.randint(0, end - 1, (1, length), generator=generator("caption", number))
        tokens[:, 0] = encoder.tokenizer.bos_token_id
        tokens[:, 2 + number % (length - 2) :] = end
        return [tokens]

    model = export(caption, examples(3), ["tokens"], ["vector"])
    compare = [examples(number) for number in (0, 1, 5, length)]
    return compared("caption", model, caption, compare, _UNITS, tolerance, ("semantics",))


def _seen(images: Tensor, views: Tensor) -> Tensor:
    """[B, 3, H, W] to [B · (1 + V), 3, H, W]: each picture plain and by each view."""
    batch, count = len(images), len(views)
    if count == 0:
        return images
    repeated = images.repeat_interleave(count, 0)
    grid = affine_grid(views.repeat(batch, 1, 1), list(repeated.shape), align_corners=False)
    moved = grid_sample(repeated, grid, mode="bilinear", padding_mode="border", align_corners=False)
    return torch.cat([images[:, None], moved.reshape(batch, count, *images.shape[1:])], 1).flatten(0, 1)


def _as_batch(image: Tensor) -> Tensor:
    """Linear light [H, W, 3] to sRGB [1, 3, H, W]."""
    return linear_to_srgb(image.clamp(0.0, 1.0)).movedim(-1, 0)[None]
