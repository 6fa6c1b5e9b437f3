"""`pentimento rate`: from folders of pictures to tested answers."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.images import write_png
from pentimento.rating.answers import read_key
from tests.rating.raters import FIRST, OTHER, picture, preferring, save


@pytest.fixture
def folders(tmp_path: Path) -> Path:
    for item in range(6):
        for number, condition in enumerate((FIRST, OTHER)):
            (tmp_path / condition).mkdir(exist_ok=True)
            write_png(tmp_path / condition / f"item{item}.png", picture(item, number))
        (tmp_path / "captions").mkdir(exist_ok=True)
        (tmp_path / "captions" / f"item{item}.txt").write_text(f"thing {item}\n")
    return tmp_path


def pages(folder: Path, *more: str, study: str = "text", out: str = "study") -> int:
    conditions = [f"--condition={name}={folder / name}" for name in (FIRST, OTHER)]
    words = ["rate", "pages", "--study", study, *conditions, "--raters", "8", "--seed", "1", "--out", str(folder / out)]
    return main([*words, *more])


def test_folders_become_pages_and_answers_a_table_and_tests(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert pages(folders, "--references", str(folders / "captions")) == 0
    written = sorted((folders / "study/pages").iterdir())
    assert [file.name for file in written] == [f"rater_{n:02d}.html" for n in range(1, 9)]
    assert "thing 3" in written[0].read_text(encoding="utf-8")
    key = read_key(folders / "study/key.json")
    (folders / "answers").mkdir()
    files = save(folders / "answers", key, preferring(FIRST, 0.9, np.random.default_rng(0)))
    command = ["rate", "results", str(folders / "study/key.json"), *map(str, files)]
    capsys.readouterr()
    assert main([*command, "--table", str(folders / "table.csv")]) == 0
    said = capsys.readouterr().out
    assert f"{FIRST} against {OTHER}" in said and "8 of 8 (100%" in said and "48 answers of 8 raters" in said
    with (folders / "table.csv").open(encoding="utf-8") as table:
        assert len(list(csv.DictReader(table))) == 48
    assert main([*command, "--table", str(folders / "table.csv")]) == 1
    assert "would be replaced" in capsys.readouterr().err


def test_what_is_missing_or_broken_ends_in_a_sentence(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def refused(status: int) -> str:
        assert status == 1
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and "Traceback" not in said
        return said

    assert "shows a text beside" in refused(pages(folders))
    alone = ["rate", "pages", "--study", "text", f"--condition=a={folders / FIRST}", "--raters", "1", "--out", "x"]
    assert "two times or more" in refused(main(alone))
    assert "no study named 'taste'" in refused(pages(folders, study="taste"))
    (folders / "captions/item2.txt").unlink()
    assert "no text of item2" in refused(pages(folders, "--references", str(folders / "captions")))
    (folders / OTHER / "item1.png").unlink()
    assert "only one has item1" in refused(pages(folders, study="panel"))
    assert not (folders / "study").exists()
    (folders / "answers.json").write_text("{")
    assert "is no key" in refused(main(["rate", "results", str(folders / "answers.json"), "x.json"]))


def test_pictures_of_another_shape_are_reported(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_png(folders / FIRST / "item0.png", picture(0, 0)[:4])
    assert pages(folders, study="panel") == 0
    assert "The pictures of item0 differ in shape" in capsys.readouterr().err
    assert len(json.loads((folders / "study/key.json").read_text())["pages"]) == 8


def test_two_folders_are_compared_without_references(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert pages(folders, study="better") == 0
    assert pages(folders, "--references", str(folders / "captions"), study="better", out="more") == 1
    assert "shows no reference" in capsys.readouterr().err
