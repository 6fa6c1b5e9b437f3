"""Models that are only half there are refused by name; whole ones are loaded in single precision."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor
from transformers import CLIPTokenizer

from pentimento.contracts.errors import ConfigError
from pentimento.semantics.encoder import Encoder

Weights = dict[str, Tensor]
POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:" + 64 * "0" + "\nsize 1234567\n"


@pytest.fixture
def folder(encoder: Encoder, tmp_path: Path) -> Path:
    encoder.save(tmp_path)
    return tmp_path


def edit(folder: Path, change: Callable[[Weights], Weights]) -> None:
    file = folder / "model.safetensors"
    save_file({name: value.contiguous() for name, value in change(load_file(file)).items()}, file, {"format": "pt"})


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 6 // 10])


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (lambda f: cut(f / "model.safetensors"), r"model\.safetensors is cut off or damaged"),
        (lambda f: (f / "model.safetensors").write_text(POINTER), r"model\.safetensors is a pointer .*git lfs pull"),
        (lambda f: (f / "config.json").write_text(POINTER), r"config\.json is a pointer"),
        (lambda f: (f / "tokenizer.json").write_text(POINTER), r"tokenizer\.json is a pointer"),
        (lambda f: (f / "vocab.json").write_text(POINTER), r"vocab\.json is a pointer"),
        (lambda f: [file.unlink() for file in f.glob("[tvm]*") if file.suffix != ".safetensors"], "tokenizer is miss"),
        (
            lambda f: torch.save({}, f / "pytorch_model.bin") or (f / "model.safetensors").unlink(),
            "its weights are pickled",
        ),
        (lambda f: [file.unlink() for file in f.glob("*.json")], "is no folder of a CLIP model"),
    ],
)
def test_missing_cut_off_and_pointer_files_are_named(
    folder: Path, damage: Callable[[Path], object], sentence: str
) -> None:
    damage(folder)
    with pytest.raises(ConfigError, match=sentence):
        Encoder.load(folder)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            lambda w: {name: value for name, value in w.items() if not name.startswith("vision_model")},
            r"lacks weights, such as vision_model\.embeddings\.class_embedding",
        ),
        (lambda w: {f"my_{name}": value for name, value in w.items()}, "lacks weights, such as logit_scale"),
        (
            lambda w: w | {"text_model.encoder.layers.9.mlp.fc1.bias": torch.zeros(4)},
            r"no place for, such as text_model\.encoder\.layers\.9\.mlp\.fc1\.bias",
        ),
        (
            lambda w: w | {"text_projection.weight": w["text_projection.weight"][:-1]},
            r"another shape than its config\.json says, such as text_projection\.weight",
        ),
        (lambda w: w | {"logit_scale": torch.tensor(float("nan"))}, "logit_scale is not finite"),
        (
            lambda w: w | {"text_projection.weight": w["text_projection.weight"].to(torch.int8)},
            r"quantised weights \(I8\)",
        ),
        (
            lambda w: w | {"text_projection.weight": w["text_projection.weight"].to(torch.float8_e4m3fn)},
            r"quantised weights \(F8_E4M3\)",
        ),
    ],
)
def test_weights_that_do_not_fill_the_model_are_refused(
    folder: Path, change: Callable[[Weights], Weights], sentence: str
) -> None:
    edit(folder, change)
    with pytest.raises(ConfigError, match=sentence):
        Encoder.load(folder)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64])
def test_other_precisions_are_loaded_in_single_precision(encoder: Encoder, folder: Path, dtype: torch.dtype) -> None:
    edit(folder, lambda w: {name: value.to(dtype) if value.is_floating_point() else value for name, value in w.items()})
    back = Encoder.load(folder)
    assert {weight.dtype for weight in back.model.parameters()} == {torch.float32}
    assert torch.allclose(back.embed_texts(["a house"]), encoder.embed_texts(["a house"]), atol=0.02)


def test_names_that_older_files_hold_in_addition_are_no_error(encoder: Encoder, folder: Path) -> None:
    edit(folder, lambda w: w | {"text_model.embeddings.position_ids": torch.arange(8)[None]})
    assert Encoder.load(folder).digest == encoder.digest


def test_variants_beside_the_weights_are_not_read(encoder: Encoder, folder: Path) -> None:
    (folder / "model.fp16.safetensors").write_text(POINTER)
    assert Encoder.load(folder).digest == encoder.digest


def test_weights_in_several_files_are_loaded_whole_or_refused(encoder: Encoder, folder: Path) -> None:
    encoder.model.save_pretrained(folder, max_shard_size="20KB")
    (folder / "model.safetensors").unlink(missing_ok=True)
    assert Encoder.load(folder).digest == encoder.digest
    second = sorted(folder.glob("model-*.safetensors"))[1]
    second.write_text(POINTER)
    with pytest.raises(ConfigError, match=rf"{second.name} is a pointer"):
        Encoder.load(folder)
    second.unlink()
    with pytest.raises(ConfigError, match=second.name):
        Encoder.load(folder)


def test_a_tokenizer_of_another_model_is_refused(encoder: Encoder, folder: Path) -> None:
    tokenizer = CLIPTokenizer.from_pretrained(folder)
    tokenizer.add_tokens(["<a new word>"])
    tokenizer.save_pretrained(folder)
    known = encoder.model.config.text_config.vocab_size
    with pytest.raises(ConfigError, match=f"knows {known + 1} tokens, and its text encoder {known}"):
        Encoder.load(folder)
