"""The text-image encoder: a CLIP model of `transformers`, trained here or published, read from a local folder.

Models trained here have a few convolutions in place of the linear map of each patch. A transformer that must first
learn which patches are neighbours learns little from a few thousand pictures. Xiao et al. 2021 ("Early convolutions
help transformers see better") put 3 x 3 convolutions of stride 2 before it, which give as many tokens as patches.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import interpolate, normalize
from transformers import CLIPConfig, CLIPModel, CLIPTokenizer

from pentimento.contracts.errors import ConfigError
from pentimento.contracts.ranges import at_least
from pentimento.semantics.devices import chosen_device
from pentimento.semantics.pretrained import check_pointers, load_pretrained, load_tokenizer

_MEAN: Final = (0.48145466, 0.4578275, 0.40821073)
_SPREAD: Final = (0.26862954, 0.26130258, 0.27577711)
"""Standard deviation of sRGB in the training data of the published models, with `_MEAN` (Radford et al. 2021)."""


class ConvolutionalCLIP(CLIPModel):
    """`CLIPModel` with a convolutional stem and otherwise the published layout.

    Its config has `convolutional_stem` under `vision_config`; see `has_stem`.
    """

    def __init__(self, config: CLIPConfig) -> None:
        """Untrained, for a config whose `patch_size` is a power of 2."""
        super().__init__(config)
        self.vision_model.embeddings = StemEmbeddings(config.vision_config)


def has_stem(config: dict[str, Any]) -> bool:
    """Whether the content of a config.json describes a `ConvolutionalCLIP`."""
    return bool((config.get("vision_config") or {}).get("convolutional_stem", False))


class StemEmbeddings(nn.Module):
    """Tokens of normalised pictures, [B, 3, H, W] to [B, 1 + L, C]: the class token first, then places by rows.

    The class token starts as the maximum of each channel over all places, so it states what a picture shows,
    independent of where.
    """

    def __init__(self, config: Any) -> None:
        """For a CLIPVisionConfig."""
        super().__init__()
        width, side = config.hidden_size, config.image_size // config.patch_size
        halvings = config.patch_size.bit_length() - 1
        widths = [max(8, width * 3 // 2 ** (halvings + 1 - step)) for step in range(halvings)]  # of 128: 24, 48, 96
        self.stem = nn.Sequential(
            *(_convolution(a, b, 2) for a, b in zip([3, *widths], widths, strict=False)),
            _convolution([3, *widths][-1], width, 1),
        )
        self.class_embedding = nn.Parameter(torch.zeros(width))
        self.position_embedding = nn.Parameter(0.02 * torch.randn(1 + side * side, width))

    def forward(self, pixel_values: Tensor, interpolate_pos_encoding: bool = False) -> Tensor:
        """The tokens; pictures must have the size of the model.

        Raises:
            ValueError: another size was asked for.
        """
        if interpolate_pos_encoding:
            raise ValueError("Positions of a convolutional stem are not interpolated; resize the picture.")
        places = self.stem(pixel_values.contiguous(memory_format=torch.channels_last)).flatten(2).transpose(1, 2)
        strongest = self.class_embedding + places.amax(1, keepdim=True)
        tokens: Tensor = torch.cat([strongest, places], 1) + self.position_embedding
        return tokens


def _convolution(wide_in: int, wide_out: int, stride: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(wide_in, wide_out, 3, stride, 1, bias=False), nn.BatchNorm2d(wide_out), nn.ReLU())


@dataclass(frozen=True)
class EncoderShape:
    """Sizes of an encoder that is trained here."""

    image_px: int
    patch_px: int
    """A power of 2: the stride of the convolutional stem."""
    image_width: int
    image_layers: int
    """Attention layers after the stem; 0 gives a convolutional tower."""
    text_width: int
    text_layers: int
    heads: int
    embedding: int

    def __post_init__(self) -> None:
        at_least(self, 1, *(name for name in self.__dataclass_fields__ if name != "image_layers"))
        at_least(self, 0, "image_layers")
        if self.image_px % self.patch_px:
            raise ValueError(f"image_px is {self.image_px}; it must be a multiple of patch_px, {self.patch_px}.")
        if self.patch_px.bit_count() != 1 or self.patch_px == 1:
            raise ValueError(f"patch_px is {self.patch_px}; it must be 2, 4, 8 or another power of 2.")
        if self.image_width % self.heads or self.text_width % self.heads:
            raise ValueError(
                f"image_width and text_width are {self.image_width} and {self.text_width}; with {self.heads} heads "
                f"both must be multiples of {self.heads}."
            )


class Encoder:
    """Embeddings of pictures and captions as unit vectors, whose cosine measures how well they match."""

    def __init__(self, model: CLIPModel, tokenizer: CLIPTokenizer) -> None:
        """Set the model to evaluation mode, without gradients of its weights."""
        self.model = model.eval().requires_grad_(False)
        # Eager attention shows its weights, which saliency reads, and exports with its gradient.
        self.model.set_attn_implementation("eager")
        self.tokenizer = tokenizer
        self.image_px: int = model.config.vision_config.image_size
        self.patch_px: int = model.config.vision_config.patch_size

    @classmethod
    def load(cls, folder: Path) -> Encoder:
        """Read a folder in the published layout (config.json, model.safetensors, vocab.json, merges.txt) to the chosen
        device; nothing is downloaded.

        Raises:
            ConfigError: the folder does not exist, or holds something else, a part of a model or damaged weights.
        """
        folder = Path(folder)
        try:
            check_pointers(folder)
            config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
            kind = config.get("model_type")
        except (OSError, ValueError, AttributeError, ConfigError) as error:
            raise ConfigError(
                f"{folder} is no folder of a CLIP model ({error}); give one with config.json, model.safetensors, "
                "vocab.json and merges.txt, as openai/clip-vit-base-patch32 has."
            ) from error
        if kind != "clip":
            raise ConfigError(f"{folder} holds a model of type {kind!r}; the encoder must be of type 'clip'.")
        model = load_pretrained(ConvolutionalCLIP if has_stem(config) else CLIPModel, folder, "The CLIP model")
        return cls(
            model.to(chosen_device()), load_tokenizer(folder, "The CLIP model", model.config.text_config.vocab_size)
        )

    def save(self, folder: Path) -> None:
        """Write the published layout into an existing folder."""
        self.model.save_pretrained(folder)
        self.tokenizer.save_pretrained(folder)
        self.tokenizer.backend_tokenizer.model.save(str(folder))  # vocab.json and merges.txt

    @property
    def digest(self) -> str:
        """SHA-256 of the weights, by name."""
        found = hashlib.sha256()
        for name, tensor in sorted(self.model.state_dict().items()):
            found.update(f"{name} {tuple(tensor.shape)} {tensor.dtype}".encode())
            found.update(tensor.detach().cpu().contiguous().numpy().tobytes())
        return found.hexdigest()

    def embed_images(self, images: Tensor) -> Tensor:
        """Unit vectors [B, D] of sRGB images [B, 3, H, W] in [0, 1], on the images' device; differentiable."""
        features = self.model.get_image_features(pixel_values=self.prepare(images)).pooler_output
        return normalize(features, dim=-1).to(images.device)

    def embed_texts(self, captions: Sequence[str]) -> Tensor:
        """Unit vectors [B, D] of captions, on the CPU; longer ones than the model reads are truncated."""
        tokens = {name: values.to(self.model.device) for name, values in self.tokens(captions).items()}
        return normalize(self.model.get_text_features(**tokens).pooler_output, dim=-1).cpu()

    def patch_features(self, images: Tensor) -> Tensor:
        """Features [B, L, C] of the patches of sRGB images [B, 3, H, W] after half of the layers, on the images'
        device; differentiable.

        Patches are in rows from the top left; L = (image_px / patch_px)².
        """
        vision = self.model.vision_model
        layers = vision.encoder.layers
        states = vision.pre_layrnorm(vision.embeddings(self.prepare(images)))
        for layer in layers[: (len(layers) + 1) // 2]:
            states = layer(states, None)
        return states[:, 1:].to(images.device)

    def prepare(self, images: Tensor) -> Tensor:
        """sRGB images [B, 3, H, W] as the model's input, on its device: resized to its square and normalised.

        They are resized where they are, since a GPU does not sum the gradient of that in a reproducible order.
        """
        if images.shape[-2:] != (self.image_px, self.image_px):
            size = (self.image_px, self.image_px)
            images = interpolate(images, size, mode="bicubic", antialias=True, align_corners=False)
        return normalise(images).to(self.model.device)

    def tokens(self, captions: Sequence[str]) -> dict[str, Tensor]:
        """Token ids and mask, [B, T] each, of captions."""
        length = self.model.config.text_config.max_position_embeddings
        return dict(
            self.tokenizer(list(captions), padding=True, truncation=True, max_length=length, return_tensors="pt")
        )


def as_images(pictures: Sequence[NDArray[np.uint8]] | NDArray[np.uint8]) -> Tensor:
    """Pictures, uint8 [H, W, 3] each, as the encoder takes them: float32 [B, 3, H, W] in [0, 1]."""
    return torch.from_numpy(np.stack([*pictures])).permute(0, 3, 1, 2).float() / 255


def normalise(images: Tensor) -> Tensor:
    """sRGB [B, 3, H, W] in [0, 1], normalised as in the training of CLIP models."""
    mean, spread = (images.new_tensor(values)[:, None, None] for values in (_MEAN, _SPREAD))
    return (images - mean) / spread


def new_model(shape: EncoderShape, tokenizer: CLIPTokenizer, seed: int) -> CLIPModel:
    """An untrained model with a convolutional stem, for a tokenizer."""
    config = CLIPConfig(
        projection_dim=shape.embedding,
        text_config={
            "vocab_size": len(tokenizer), "hidden_size": shape.text_width, "intermediate_size": 2 * shape.text_width,
            "num_hidden_layers": shape.text_layers, "num_attention_heads": shape.heads,
            "max_position_embeddings": tokenizer.model_max_length, "projection_dim": shape.embedding,
            "bos_token_id": tokenizer.bos_token_id, "eos_token_id": tokenizer.eos_token_id,
            "pad_token_id": tokenizer.pad_token_id,
        },
        vision_config={
            "image_size": shape.image_px, "patch_size": shape.patch_px, "hidden_size": shape.image_width,
            "intermediate_size": 2 * shape.image_width, "num_hidden_layers": shape.image_layers,
            "num_attention_heads": shape.heads, "projection_dim": shape.embedding, "convolutional_stem": True,
        },
    )  # fmt: skip
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return ConvolutionalCLIP(config)
