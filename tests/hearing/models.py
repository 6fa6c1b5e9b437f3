"""Test support: Whisper and CLAP with random weights, tiny, in the published layout."""

from __future__ import annotations

from pathlib import Path

import torch
from transformers import (
    ClapConfig,
    ClapFeatureExtractor,
    ClapModel,
    ClapProcessor,
    GenerationConfig,
    RobertaTokenizer,
    WhisperConfig,
    WhisperFeatureExtractor,
    WhisperForConditionalGeneration,
    WhisperProcessor,
    WhisperTokenizer,
)
from transformers.convert_slow_tokenizer import bytes_to_unicode


def _bytes(*special: str) -> dict[str, int]:
    """A vocabulary of single bytes, after special tokens."""
    return {token: number for number, token in enumerate([*special, *bytes_to_unicode().values()])}


def write_whisper(folder: Path) -> Path:
    """Write a Whisper model of English."""
    words = _bytes("<|endoftext|>", "<|startoftranscript|>", "<|notimestamps|>", "<|nospeech|>")
    torch.manual_seed(0)
    config = WhisperConfig(
        vocab_size=len(words), num_mel_bins=16, d_model=16, encoder_layers=1, decoder_layers=1,
        encoder_attention_heads=2,
        decoder_attention_heads=2, encoder_ffn_dim=16, decoder_ffn_dim=16, max_target_positions=128,
        pad_token_id=0, bos_token_id=0, eos_token_id=0, decoder_start_token_id=1, suppress_tokens=None,
        begin_suppress_tokens=None,
    )  # fmt: skip
    model = WhisperForConditionalGeneration(config)
    model.generation_config = GenerationConfig(
        is_multilingual=False, decoder_start_token_id=1, eos_token_id=0, pad_token_id=0, bos_token_id=0,
        no_timestamps_token_id=2, max_length=100, suppress_tokens=[], begin_suppress_tokens=[0],
    )  # fmt: skip
    tokenizer = WhisperTokenizer(
        vocab=words, merges=[], unk_token="<|endoftext|>", bos_token="<|endoftext|>", eos_token="<|endoftext|>",
        additional_special_tokens=["<|startoftranscript|>", "<|notimestamps|>", "<|nospeech|>"],
    )  # fmt: skip
    model.save_pretrained(folder)
    WhisperProcessor(WhisperFeatureExtractor(feature_size=16), tokenizer).save_pretrained(folder)
    return folder


def write_clap(folder: Path) -> Path:
    """Write a CLAP model."""
    words = _bytes("<s>", "<pad>", "</s>", "<unk>", "<mask>")
    torch.manual_seed(0)
    text = {
        "vocab_size": len(words), "hidden_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2,
        "intermediate_size": 16, "max_position_embeddings": 130, "projection_dim": 16,
    }  # fmt: skip
    audio = {
        "spec_size": 256, "num_mel_bins": 64, "patch_size": 4, "patch_stride": [4, 4], "patch_embeds_hidden_size": 8,
        "depths": [1, 1], "num_attention_heads": [2, 2], "hidden_size": 16, "window_size": 8, "projection_dim": 16,
        "num_classes": 2, "enable_fusion": False,
    }  # fmt: skip
    model = ClapModel(ClapConfig(text_config=text, audio_config=audio, projection_dim=16))
    model.save_pretrained(folder)
    listener = ClapFeatureExtractor(feature_size=64, sampling_rate=48_000, truncation="rand_trunc", padding="repeatpad")
    ClapProcessor(listener, RobertaTokenizer(vocab=words, merges=[])).save_pretrained(folder)
    return folder
