"""YAML is edited in place: what is not touched stays byte by byte."""

from pathlib import Path

import pytest

from pentimento.cli.scaffold.project_yaml import ProjectYaml, add_copy, add_item, with_option
from pentimento.contracts.errors import ConfigError
from pipelines._imports import ROOT

WRITTEN = """\
# of the file
settings:
  first:
    tool: pen   # beside a value
    sizes: [1.0, 0.80]
    nothing: null
    # before a value
    deep:
      last: 2 mm  # beside the last value

  # before the next one
  second: {tool: brush}
after: 'quoted'
"""


def opened(folder: Path, text: str) -> ProjectYaml:
    (folder / "file.yaml").write_text(text)
    return ProjectYaml(folder / "file.yaml")


@pytest.mark.parametrize(
    "path", [ROOT / "dvc.yaml", ROOT / "params.yaml", *(ROOT / "profiles").glob("*.yaml")], ids=lambda path: path.name
)
def test_the_project_s_files_are_written_as_they_were_read(path: Path) -> None:
    assert ProjectYaml(path).text() == path.read_text()


def test_a_copy_stands_after_its_model_and_takes_no_comment_away(tmp_path: Path) -> None:
    file = opened(tmp_path, WRITTEN)
    add_copy(file.content["settings"], "first", "new")["tool"] = "quill"
    copied = """\
  new:
    tool: quill
    sizes: [1.0, 0.80]
    nothing: null
    deep:
      last: 2 mm
"""
    assert file.text() == WRITTEN.replace("\n  # before the next one", f"{copied}\n  # before the next one")


def test_an_item_at_the_end_of_a_list_leaves_the_blank_line_after_the_list(tmp_path: Path) -> None:
    file = opened(tmp_path, "deps:\n  - one\n  - two  # why\n\n# next\nouts: [a]\n")
    add_item(file.content["deps"], "two", "three")
    add_item(file.content["outs"], "a", "b")
    assert file.text() == "deps:\n  - one\n  - two  # why\n  - three\n\n# next\nouts: [a, b]\n"


def test_a_folded_command_stays_folded_and_only_the_option_named_grows(tmp_path: Path) -> None:
    text = "cmd: >-\n  run --tools pen brush --settings\n  pen --out brush\n"
    file = opened(tmp_path, text)
    file.content["cmd"] = with_option(file.content["cmd"], "--tools", "brush", "quill")
    assert file.text() == text.replace("pen brush", "pen brush quill")
    assert with_option(file.content["cmd"], "--settings", "brush", "quill") == file.content["cmd"]


@pytest.mark.parametrize("text", ["a: [", "- a list\n", "a: 1\na: 2\n"], ids=["torn", "no sections", "a key twice"])
def test_what_is_no_such_file_is_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"file\.yaml"):
        opened(tmp_path, text)
