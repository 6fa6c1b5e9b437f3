"""The project's YAML files, edited in place: comments, order, line breaks and everything else stay as they are."""

from __future__ import annotations

import copy
import io
import re
from pathlib import Path
from typing import Any

from pentimento.contracts.errors import ConfigError

_FOLD = "fold_pos"


class ProjectYaml:
    """One YAML file: its path, and its content to edit."""

    def __init__(self, path: Path) -> None:
        """Raises ConfigError where the file is missing or cannot be read as YAML."""
        from ruamel.yaml.error import YAMLError

        self.path = path
        self._yaml = _round_trip()
        try:
            self.content: Any = self._yaml.load(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise ConfigError(f"{path} does not exist; run this in the root of the project's folder.") from None
        except (YAMLError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path} is not readable as YAML: {' '.join(str(error).split())}; correct it.") from None
        if not isinstance(self.content, dict):
            raise ConfigError(f"{path} does not hold sections; take the file from the repository.")

    def text(self) -> str:
        """The file as it is to be written."""
        written = io.StringIO()
        self._yaml.dump(self.content, written)
        return written.getvalue()

    def at(self, *keys: str) -> Any:
        """What stands under the keys, or None where one of them is missing."""
        value: Any = self.content
        for key in keys:
            if not isinstance(value, dict) or key not in value:
                return None
            value = value[key]
        return value

    def needed(self, *keys: str) -> Any:
        """The mapping or list under the keys.

        Raises ConfigError where there is none.
        """
        value = self.at(*keys)
        if not isinstance(value, dict | list):
            raise ConfigError(f"{self.path} has no section {'.'.join(keys)}; take the file from the repository.")
        return value


def _round_trip() -> Any:
    from ruamel.yaml import YAML

    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 10_000  # lines are broken where they were
    yaml.indent(mapping=2, sequence=4, offset=2)
    yaml.representer.add_representer(type(None), lambda to, _: to.represent_scalar("tag:yaml.org,2002:null", "null"))
    return yaml


def add_copy(entries: Any, like: str, name: str) -> Any:
    """Put a copy of the entry ``like`` of a mapping right after it, as ``name``; returns the copy.

    A comment that stands after the entry belongs to what follows, and goes on following.
    """
    value = _bare(entries[like])
    entries.insert(list(entries).index(like) + 1, name, value)
    _move_comment(_last_leaf(entries, like), _last_leaf(entries, name))
    return value


def add_item(items: Any, like: str, item: str) -> None:
    """Put an item right after the item ``like`` of a list."""
    at = list(items).index(like)
    items.insert(at + 1, item)
    _move_comment((items, at), (items, at + 1))


def with_option(command: Any, option: str, like: str, name: str) -> Any:
    """A command line in which ``name`` stands after ``like`` in an option's list; folded lines stay folded."""
    found = re.search(rf"{re.escape(option)}(?: (?!-)\S+)*? {re.escape(like)}(?=\s|$)", str(command))
    if found is None:
        return command
    return _inserted(command, found.end(), f" {name}")


def _inserted(text: Any, at: int, more: str) -> Any:
    edited = type(text)(f"{str(text)[:at]}{more}{str(text)[at:]}")
    if hasattr(text, _FOLD):
        setattr(edited, _FOLD, [place + len(more) * (place >= at) for place in getattr(text, _FOLD)])
    if hasattr(text, "comment"):
        edited.comment = text.comment
    return edited


def _last_leaf(entries: Any, key: Any) -> tuple[Any, Any]:
    """The container and key of what is written last of an entry: where a comment after it hangs."""
    value = entries[key]
    if not isinstance(value, dict | list) or not value or _is_flow(value):
        return entries, key
    return _last_leaf(value, list(value)[-1]) if isinstance(value, dict) else (value, len(value) - 1)


def _is_flow(value: Any) -> bool:
    """Whether a mapping or list is written in braces or brackets."""
    return bool(value.fa.flow_style())


def _move_comment(old: tuple[Any, Any], new: tuple[Any, Any]) -> None:
    (source, key), (target, name) = old, new
    tokens: list[Any] = source.ca.items.get(key) or []
    # A sequence keeps the comment after an item first, a mapping keeps that after a value third.
    place = 0 if isinstance(source, list) else 2
    after = tokens[place] if len(tokens) > place else None
    if after is None:
        return
    own, newline, following = after.value.partition("\n")
    moved = copy.copy(after)
    moved.value = newline + following
    target.ca.items[name] = [*([None] * place), moved, *([None] * (3 - place))]
    if own:
        after.value = own + "\n"
    else:
        tokens[place] = None


def _bare(value: Any) -> Any:
    """A copy that is written in the same way and has no comments."""
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    if isinstance(value, dict):
        copied: Any = CommentedMap((key, _bare(inner)) for key, inner in value.items())
    elif isinstance(value, list):
        copied = CommentedSeq(_bare(inner) for inner in value)
    else:
        return value
    if _is_flow(value):
        copied.fa.set_flow_style()
    return copied
