"""Models of transformers and diffusers from local folders: whole and in single precision, or refused by name.

These libraries draw what a file lacks at random and pass over what they do not know, with a line in their log. Here a
model whose weights are missing, of other names, cut off, not downloaded or not finite is an error.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import torch
from safetensors import SafetensorError, safe_open
from transformers import CLIPTokenizer

from pentimento.contracts.errors import ConfigError

_POINTERS: Final = (b"version https://git-lfs", b"# xet version", b"/annex/objects/", b"../.git/annex/")
"""First bytes of files that stand for large ones: Git LFS, Xet and git-annex."""
_LOADED: Final = ("F64", "F32", "F16", "BF16", "I64", "I32", "BOOL")
"""Types of weights that mean what they say. Others are quantised, and their numbers mean nothing without a scale."""
_DERIVED: Final = ("position_ids", "num_batches_tracked", "inv_freq")
"""Ends of names that older files hold and newer code computes."""
_HALF: Final = "fp16"
"""The variant of weights that is read where a folder has no other."""
_SHOWN: Final = 3
"""Names in a message."""
_BROKEN: Final = (
    OSError, RuntimeError, ValueError, TypeError, KeyError, AttributeError, ImportError, SafetensorError,
)  # fmt: skip
"""What the libraries raise for folders that they cannot load."""


def load_pretrained(kind: Any, folder: Path, what: str, *, subfolder: str = "") -> Any:
    """The model of a folder with safetensors, in float32 and evaluation mode; nothing is downloaded.

    Args:
        kind: the class, with `from_pretrained` of transformers or diffusers.
        what: names the model in messages, such as "The CLIP model".

    Raises:
        ConfigError: the folder holds no such model, a part of it, or damaged weights.
    """
    place = Path(folder) / subfolder
    with unreadable(f"{what} in {place}"):
        check_files(place)
        _check_format(place, kind)
        model, found = kind.from_pretrained(
            folder, subfolder=subfolder, local_files_only=True, use_safetensors=True, dtype=torch.float32,
            variant=_variant(place), output_loading_info=True, ignore_mismatched_sizes=True,
        )  # fmt: skip
        _check_names(found)
        model = model.float().eval()
        _check_weights(model)
    return model


@contextmanager
def unreadable(what: str) -> Iterator[None]:
    """Any error of the libraries within becomes a ConfigError: `what` cannot be read."""
    try:
        yield
    except (ConfigError, *_BROKEN) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        if not isinstance(error, ConfigError):
            reason = reason[:400]
        raise ConfigError(f"{what} cannot be read: {reason}.") from error


def check_pointers(place: Path) -> None:
    """Raise ConfigError if a file of a model is a pointer to it."""
    for file in _files(place):
        _check_pointer(file)


def _check_pointer(file: Path) -> None:
    with file.open("rb") as opened:
        if opened.read(40).startswith(_POINTERS):
            raise ConfigError(f"{file.name} is a pointer and not the file; fetch it with `git lfs pull`")


def check_file(file: Path) -> None:
    """Check that a file of a model is there, and no pointer to it.

    Raises:
        ConfigError: the file is a pointer, or its weights are cut off, damaged or quantised.
    """
    _check_pointer(file)
    if file.suffix == ".safetensors":
        _check_safetensors(file)


def check_files(place: Path) -> None:
    """`check_file` for each file of a model."""
    for file in _files(place):
        check_file(file)


def _files(place: Path) -> list[Path]:
    """The files that are read: of the safetensors, those of the folder's variant alone."""
    variant = _variant(place)

    def is_read(file: Path) -> bool:
        if file.suffix != ".safetensors":
            return file.suffix in (".json", ".txt", ".model")
        return _variant_of(file) == variant

    return sorted(file for file in place.glob("*") if is_read(file))


def _variant(place: Path) -> str | None:
    """`fp16` for a folder that has weights of this variant alone."""
    found = {_variant_of(file) for file in place.glob("*.safetensors")}
    return _HALF if _HALF in found and None not in found else None


def _variant_of(file: Path) -> str | None:
    """`fp16` of `model.fp16.safetensors` and `model.fp16-00001-of-00002.safetensors`; None where there is none."""
    variant = file.name.removesuffix(".safetensors").partition(".")[2]
    return variant.partition("-")[0] or None


def _check_format(place: Path, kind: Any) -> None:
    pickled = sorted(place.glob("*.bin"))
    if pickled and not [*place.glob("*.safetensors")]:
        command = (
            f"from {kind.__module__} import {kind.__name__} as Model; Model.from_pretrained({str(place)!r}, "
            f"use_safetensors=False).save_pretrained({str(place)!r})"
        )
        raise ConfigError(
            f"its weights are pickled ({pickled[0].name}), and only safetensors are read; if you trust where they come "
            f'from, convert them: python -c "{command}"'
        )


def _check_safetensors(file: Path) -> None:
    try:
        with safe_open(file, framework="pt") as weights:
            types = {weights.get_slice(name).get_dtype() for name in weights.keys()}  # noqa: SIM118
    except SafetensorError as error:
        raise ConfigError(f"{file.name} is cut off or damaged ({error}); download it again") from error
    if strange := sorted(types - set(_LOADED)):
        raise ConfigError(f"{file.name} has quantised weights ({', '.join(strange)}); take those in float32 or float16")


def _check_names(found: dict[str, Any]) -> None:
    """Check what `from_pretrained` says of the names in the files."""
    missing, unknown = (_listed(found.get(key, ())) for key in ("missing_keys", "unexpected_keys"))
    if missing:
        raise ConfigError(f"its file lacks weights, such as {missing}; download the whole model")
    if unknown:
        raise ConfigError(f"its file has weights that its config.json has no place for, such as {unknown}")
    if mismatched := _listed(found.get("mismatched_keys", ())):
        raise ConfigError(f"weights have another shape than its config.json says, such as {mismatched}")
    if messages := list(found.get("error_msgs", ())):
        raise ConfigError(str(messages[0]))


def _listed(names: Iterable[Any]) -> str:
    texts = sorted(str(name[0] if isinstance(name, tuple) else name) for name in names)
    texts = [text for text in texts if not text.endswith(_DERIVED)]
    return ", ".join(texts[:_SHOWN]) + (f" and {len(texts) - _SHOWN} more" if len(texts) > _SHOWN else "")


def _check_weights(model: torch.nn.Module) -> None:
    for name, weight in model.state_dict().items():
        if weight.is_meta:
            raise ConfigError(f"its file lacks the weight {name}; download the whole model")
        if weight.is_floating_point() and not bool(torch.isfinite(weight).all()):
            raise ConfigError(f"the weight {name} is not finite; the file is damaged, download it again")


def load_tokenizer(folder: Path, what: str, words: int, *, subfolder: str = "") -> CLIPTokenizer:
    """The tokenizer of a folder, for a text encoder that knows this number of tokens.

    Raises:
        ConfigError: its files are missing or broken, or it has another number of tokens.
    """
    place = Path(folder) / subfolder
    with unreadable(f"{what} in {place}"):
        check_files(place)
        files = {file.name for file in place.glob("*")}
        if not ("tokenizer.json" in files or {"vocab.json", "merges.txt"} <= files):
            raise ConfigError("its tokenizer is missing: vocab.json and merges.txt, or tokenizer.json")
        for name in {"tokenizer.json", "vocab.json"} & files:
            json.loads((place / name).read_text(encoding="utf-8"))
        tokenizer = CLIPTokenizer.from_pretrained(folder, subfolder=subfolder, local_files_only=True)
        if len(tokenizer) != words:
            raise ConfigError(f"its tokenizer knows {len(tokenizer)} tokens, and its text encoder {words}")
    return tokenizer
