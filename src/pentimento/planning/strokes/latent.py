"""A handwriting style as a file: the decoder of a TrajVAE and the latents of the demonstrations, in numpy alone.

Another file is another writer's style. Nothing is trained for it again (thesis 5.3.3).
"""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pentimento.contracts.atomic import atomic_write
from pentimento.contracts.errors import ContractError
from pentimento.planning.strokes.shapes import ShapePull

Array = NDArray[np.float32]

_MIN_SPREAD = 1e-3
"""Floor under a latent's standard deviation, so that a latent that never varies can still move."""


@dataclass(frozen=True, eq=False)
class Layer:
    """x → x @ weight + bias."""

    weight: Array  # [inputs, outputs]
    bias: Array  # [outputs]


@dataclass(frozen=True, eq=False)
class StyleDecoder:
    """One writer's handwriting style. As ``Shapes``, its parameters are the latent, P = L."""

    hand: str
    """Identifier of the writer."""
    layers: tuple[Layer, ...]
    """With SiLU between them. The last gives x and y of the points in turn, in units of ``scale_m``."""
    scale_m: float
    latent_mean: Array
    """[K, L] of the demonstrations."""
    latent_deviation: Array
    """[K, L]."""

    @property
    def points(self) -> int:
        """N, of each path."""
        return len(self.layers[-1].bias) // 2

    @property
    def spread(self) -> Array:
        """[L] standard deviation of the latents over the demonstrations."""
        variance = self.latent_mean.var(0) + np.square(self.latent_deviation).mean(0)
        return np.maximum(np.sqrt(variance), np.float32(_MIN_SPREAD))

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Latents [count, L], each from the posterior of a random demonstration."""
        k = rng.integers(len(self.latent_mean), size=count)
        noise = rng.standard_normal((count, self.latent_mean.shape[1]), dtype=np.float32)
        return self.latent_mean[k] + self.latent_deviation[k] * noise

    def decode(self, latent: Array) -> tuple[Array, ShapePull]:
        """Paths [S, N, 2] in metres, as the TrajVAE gives them, and the pull-back."""
        values: Array = latent
        slopes: list[Array] = []
        for number, layer in enumerate(self.layers):
            if number > 0:
                gate = np.asarray(1 / (1 + np.exp(-values)), dtype=np.float32)
                slopes.append(gate * (1 + values * (1 - gate)))  # derivative of SiLU
                values = values * gate
            values = np.asarray(values @ layer.weight + layer.bias, dtype=np.float32)
        scale = np.float32(self.scale_m)

        def pull(of_path: Array) -> Array:
            back = of_path.reshape(len(of_path), 2 * self.points) * scale
            for number in range(len(self.layers) - 1, -1, -1):
                back = back @ self.layers[number].weight.T
                if number > 0:
                    back = back * slopes[number - 1]
            return back

        return (values * scale).reshape(len(latent), self.points, 2), pull

    def paths(self, parameters: Array) -> tuple[Array, ShapePull]:
        """See ``Shapes``. Decoded strokes head along +x as far as the model learned it."""
        path, back = self.decode(parameters)

        def pull(of_path: Array) -> Array:
            return back(of_path - of_path.mean(1, keepdims=True))

        return path - path.mean(1, keepdims=True), pull

    def constrain(self, parameters: Array, start: Array, reach: float) -> None:
        """See ``Shapes``. Far from all demonstrations the decoder extrapolates."""
        bound = np.float32(reach) * self.spread
        np.clip(parameters, start - bound, start + bound, out=parameters)


def write_decoder(path: Path, decoder: StyleDecoder) -> None:
    """Write a decoder atomically. Equal decoders give equal bytes.

    Raises:
        ContractError: a number is not finite.
    """
    atomic_write(Path(path), decoder_bytes(decoder))


def decoder_bytes(decoder: StyleDecoder) -> bytes:
    """The content of a decoder's file.

    Raises:
        ContractError: a number is not finite.
    """
    arrays = {
        "hand": np.array(decoder.hand),
        "scale_m": np.array(decoder.scale_m),
        "latent_mean": decoder.latent_mean,
        "latent_deviation": decoder.latent_deviation,
    }
    for number, layer in enumerate(decoder.layers):
        arrays |= {f"weight_{number}": layer.weight, f"bias_{number}": layer.bias}
    broken = [name for name, values in arrays.items() if name != "hand" and not np.isfinite(values).all()]
    if broken:
        raise ContractError(f"The decoder of {decoder.hand} is not finite in {broken}; train it again.")
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def read_decoder(path: Path) -> StyleDecoder:
    """Read what ``write_decoder`` wrote.

    Raises:
        ContractError: the file is missing or damaged, or its arrays do not fit together.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise ContractError(f"{path} holds no decoder ({error}); make it with the stage train_trajvae.") from error
    return decoder_from(content, str(path))


def decoder_from(content: bytes, path: str) -> StyleDecoder:
    """The decoder in a file's content; ``path`` names the file in messages.

    Raises:
        ContractError: the content is damaged, or its arrays do not fit together.
    """
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            count = sum(name.startswith("weight_") for name in stored)
            layers = tuple(Layer(stored[f"weight_{n}"], stored[f"bias_{n}"]) for n in range(count))
            decoder = StyleDecoder(
                str(stored["hand"]), layers, float(stored["scale_m"]), stored["latent_mean"], stored["latent_deviation"]
            )
            if not all(np.isfinite(values).all() for name, values in stored.items() if name != "hand"):
                raise ValueError("a number is not finite")
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, NotImplementedError) as error:
        raise ContractError(f"{path} holds no decoder ({error}); make it with the stage train_trajvae.") from error
    sizes = [decoder.latent_mean.shape[1:2], *(layer.weight.shape[1:2] for layer in layers)]
    fits = layers and all(
        layer.weight.ndim == 2 and layer.weight.shape[:1] == size and layer.bias.shape == layer.weight.shape[1:]
        for layer, size in zip(layers, sizes, strict=False)
    )
    known = decoder.latent_mean.shape == decoder.latent_deviation.shape and len(decoder.latent_mean) > 0
    if not (fits and known and len(layers[-1].bias) % 2 == 0):
        raise ContractError(f"The arrays of {path} do not fit together; make it again with the stage train_trajvae.")
    return decoder
