"""Networks in their published shapes, with random weights."""

from __future__ import annotations

import json

import torch
from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
from transformers import CLIPConfig, CLIPModel, CLIPTextConfig, CLIPTextModel, CLIPTokenizer

from pentimento.copainting.goal.planner import GoalPlanner
from pentimento.semantics.tokenizer import END, START, learn_tokenizer

CAPTIONS = ("a red disc", "a blue square", "a green disc on grey", "a yellow square")
TOKENS = 77
WORDS = 49408
_TEXT_OF = {"b32": (512, 2048, 8), "l14": (768, 3072, 12)}
"""Of the text half: width, width of the hidden layer, heads; 12 layers each."""
_VISION_OF = {"b32": (768, 3072, 12, 12, 32), "l14": (1024, 4096, 16, 24, 14)}
"""Of the vision half: width, width of the hidden layer, heads, layers, px of a patch."""


def published_tokenizer() -> CLIPTokenizer:
    """A tokenizer of as many tokens as the published one; most of them are fillers that no text contains."""
    learned = json.loads(learn_tokenizer(CAPTIONS, 40, TOKENS).backend_tokenizer.to_str())["model"]
    words = [word for word in learned["vocab"] if word not in (START, END)]
    words += [f"filler{number}" for number in range(WORDS - len(words) - 2)]
    vocabulary = {word: index for index, word in enumerate([*words, START, END])}
    return CLIPTokenizer(vocab=vocabulary, merges=[tuple(pair) for pair in learned["merges"]], model_max_length=TOKENS)


def published_planner() -> GoalPlanner:
    """Instruct-Pix2Pix in its published shapes, untrained."""
    torch.manual_seed(0)
    tokenizer = published_tokenizer()
    text = CLIPTextConfig(
        vocab_size=WORDS, hidden_size=768, intermediate_size=3072, num_hidden_layers=12, num_attention_heads=12,
        max_position_embeddings=TOKENS, bos_token_id=tokenizer.bos_token_id, eos_token_id=tokenizer.eos_token_id,
    )  # fmt: skip
    blocks = 4
    vae = AutoencoderKL(
        down_block_types=("DownEncoderBlock2D",) * blocks,
        up_block_types=("UpDecoderBlock2D",) * blocks,
        block_out_channels=(128, 256, 512, 512),
        layers_per_block=2,
        latent_channels=4,
        sample_size=512,
    )
    return GoalPlanner(
        vae=vae.eval().requires_grad_(False),
        text_encoder=CLIPTextModel(text).eval(),
        tokenizer=tokenizer,
        unet=UNet2DConditionModel(sample_size=64, in_channels=8, out_channels=4, cross_attention_dim=768),
        scheduler=DDIMScheduler(
            beta_start=0.00085, beta_end=0.012, beta_schedule="scaled_linear", clip_sample=False, steps_offset=1
        ),
        safety_checker=None,
        feature_extractor=None,
        image_encoder=None,
        requires_safety_checker=False,
    )


def published_clip(name: str) -> CLIPModel:
    """`openai/clip-vit-base-patch32` ("b32") or `openai/clip-vit-large-patch14` ("l14"), untrained."""
    torch.manual_seed(0)
    tokenizer = published_tokenizer()
    (width, hidden, heads), (across, deep, eyes, layers, patch) = _TEXT_OF[name], _VISION_OF[name]
    text = {
        "vocab_size": WORDS, "hidden_size": width, "intermediate_size": hidden, "num_hidden_layers": 12,
        "num_attention_heads": heads, "max_position_embeddings": TOKENS, "projection_dim": width,
        "bos_token_id": tokenizer.bos_token_id, "eos_token_id": tokenizer.eos_token_id,
    }  # fmt: skip
    vision = {
        "hidden_size": across, "intermediate_size": deep, "num_attention_heads": eyes, "num_hidden_layers": layers,
        "patch_size": patch, "image_size": 224, "projection_dim": width,
    }  # fmt: skip
    return CLIPModel(CLIPConfig(text_config=text, vision_config=vision, projection_dim=width)).eval()
