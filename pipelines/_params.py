"""params.yaml as a whole: presets, and the profiles that overlay it.

A mapping with the key `preset` stands for the mapping of that name in the same file (a dotted path from the top,
such as `planners.pen`), with its other keys in place of the preset's, key by key:

    planner: {preset: planners.pen, iterations_free: 40}

Sections that no stage has hold nothing but presets. A stage lists those that it uses under `params` in dvc.yaml.
"""

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from pentimento.contracts.errors import ConfigError

PRESET = "preset"
_VARIABLE = re.compile(r"\$\{(\w+)\}")
_LONGEST_PATH = 1000
Params = dict[str, Any]


def read_yaml(path: Path) -> Params:
    """Return the mapping in a YAML 1.2 file (as DVC reads it: `1e-3` is a number, a duplicate key is an error)."""
    try:
        document = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path} does not exist; run from the repository's root, or restore the file.") from None
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else "?"
        problem = " ".join(str(error.problem).split())
        raise ConfigError(f"{path} is not valid YAML at line {line}: {problem}; correct that line.") from None
    except (YAMLError, UnicodeDecodeError) as error:
        problem = " ".join(str(error).split())
        raise ConfigError(f"{path} is not readable as YAML: {problem}; save it as plain UTF-8 text.") from None
    if not isinstance(document, dict):
        found = "empty" if document is None else repr(document)
        raise ConfigError(f"{path} holds {found} where sections are expected; write `section:` lines.")
    return document


def read_params(path: Path) -> Params:
    """Return the sections of params.yaml with every preset replaced by its values.

    Raises `ConfigError` for a file that cannot be read, and for a preset that does not exist or refers to itself.
    """
    document = read_yaml(path)
    try:
        return resolved(document)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def resolved(document: Params) -> Params:
    """Return the sections with every preset replaced by its values."""
    return {name: _resolved(section, document, name, ()) for name, section in document.items()}


def sections_of(stage: str, document: Params) -> list[str]:
    """Return the sections that a stage depends on: its own, then those of its presets, in the file's order."""
    found, waiting = {stage}, [stage]
    while waiting:
        used = {name.partition(".")[0] for name in _preset_names(document[waiting.pop()])} - found
        found |= used
        waiting += used
    return [stage, *(name for name in document if name in found - {stage})]


def files_named_by(stage: str, document: Params, root: Path) -> list[str]:
    """Return the files and folders that exist and that the sections of a stage name, relative to `root` or absolute.

    A folder counts only where its name has a slash, because a single word may mean something else.
    """
    found: dict[str, None] = {}
    for section in sections_of(stage, document):
        for text in _texts(document[section]):
            if len(text) < _LONGEST_PATH and "\n" not in text and "\0" not in text:
                path = root / text
                if os.path.isfile(path) or ("/" in text and os.path.isdir(path)):
                    found[os.path.normpath(text)] = None
    return list(found)


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for entry in value.values() if isinstance(value, dict) else value:
            yield from _texts(entry)


def reseeded(document: Params, stage: str, by: int) -> Params:
    """Return params.yaml with `by` added to every seed of a stage's section: `seed` and `<name>_seed` at any depth.

    Seeds that come from a preset are written beside it. `ConfigError` where the stage has no section or no seed.
    """
    if stage not in document:
        raise ConfigError(f"params.yaml has no section {stage}; name a stage of dvc.yaml, or stage@item.")
    seeds = _seeds(resolved(document)[stage], by)
    if not seeds:
        raise ConfigError(f"{stage} has no seed in params.yaml, so that all its runs are the same.")
    return document | {stage: _replaced(document[stage], seeds)}


def _seeds(section: Params, by: int) -> Params:
    """Return the seeds of a section that has no presets, with `by` added, in their nested mappings."""
    found: Params = {}
    for key, value in section.items():
        if isinstance(value, dict):
            found |= {key: inner} if (inner := _seeds(value, by)) else {}
        elif (key == "seed" or key.endswith("_seed")) and isinstance(value, int):
            found[key] = value + by
    return found


def overlaid(root: Path, profile: str) -> Params:
    """Return params.yaml in `root` overlaid by `profiles/<profile>.yaml`; presets stay references.

    `${NAME}` in a text of the profile stands for the environment variable NAME; `ConfigError` where it is not set.
    """
    source = root / "profiles" / f"{profile}.yaml"
    if not source.is_file():
        known = ", ".join(sorted(file.stem for file in source.parent.glob("*.yaml")))
        raise ConfigError(f"there is no profile {profile!r}; known are {known}.")
    place = source.relative_to(root)
    return merge(read_yaml(root / "params.yaml"), _with_environment(read_yaml(source), place), place)


def _with_environment(value: Any, source: Path) -> Any:
    """Return a value of a profile with the environment variables that its texts name."""
    if isinstance(value, dict):
        return {key: _with_environment(entry, source) for key, entry in value.items()}
    if isinstance(value, list):
        return [_with_environment(entry, source) for entry in value]
    return _VARIABLE.sub(lambda name: _variable(name[1], source), value) if isinstance(value, str) else value


def _variable(name: str, source: Path) -> str:
    found = os.environ.get(name)
    if not found:
        raise ConfigError(
            f"set the environment variable {name} to the folder of your recordings; the first lines of {source} say "
            "what it must hold."
        )
    return found


def merge(base: Params, over: Params, source: Path) -> Params:
    """Return params.yaml `base` with the values of the profile `over`, read from `source`.

    Every key of the profile must exist in `base` once its presets are resolved, else `ConfigError`; an empty mapping
    takes any key. Null may replace a section, and a whole section may replace null.
    """
    return _merged(base, over, resolved(base), base, f"{source}: ")


def _merged(base: Params, over: Params, known: Params, document: Params, place: str) -> Params:
    """Merge one mapping; `known` is `base` with its presets resolved."""
    if PRESET in base and PRESET in over:
        known = {PRESET: None} | _resolved(base | {PRESET: over[PRESET]}, document, place, ())
    merged = dict(base)
    for key, value in over.items():
        if known and key not in known:
            raise ConfigError(f"{place}{key} is not in params.yaml; correct the name or add it there.")
        current = known.get(key)
        if None not in (current, value) and isinstance(current, dict) != isinstance(value, dict):
            raise ConfigError(f"{place}{key} is a section in one file and a value in the other.")
        if isinstance(current, dict) and isinstance(value, dict):
            merged[key] = _merged(base.get(key, {}), value, current, document, f"{place}{key}.")
        else:
            merged[key] = value
    return merged


def _resolved(value: Any, document: Params, place: str, within: tuple[str, ...]) -> Any:
    """Resolve one value at `place`; `within` are the presets that are being resolved around it."""
    if isinstance(value, list):
        return [_resolved(entry, document, f"{place}[{index}]", within) for index, entry in enumerate(value)]
    if not isinstance(value, dict):
        return value
    own = {k: _resolved(entry, document, f"{place}.{k}", within) for k, entry in value.items() if k != PRESET}
    if PRESET not in value:
        return own
    name = value[PRESET]
    if name in within:
        raise ConfigError(f"{place}.preset is {name!r}, which refers to itself; name another preset.")
    return _replaced(_resolved(_at(document, name, place), document, str(name), (*within, name)), own)


def _at(document: Params, name: Any, place: str) -> Params:
    """Return the mapping under a dotted path."""
    found: Any = document
    for key in str(name).split("."):
        found = found.get(key) if isinstance(found, dict) else None
    if not isinstance(found, dict):
        raise ConfigError(f"{place}.preset is {name!r}, which names no mapping of the file; correct the path.")
    return found


def _replaced(base: Params, over: Mapping[str, Any]) -> Params:
    """Return `base` with the entries of `over`, nested mappings key by key."""
    both = {key for key in over if isinstance(base.get(key), dict) and isinstance(over[key], dict)}
    return base | {key: _replaced(base[key], over[key]) if key in both else over[key] for key in over}


def _preset_names(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        if PRESET in value:
            yield str(value[PRESET])
        value = list(value.values())
    if isinstance(value, list):
        for entry in value:
            yield from _preset_names(entry)
