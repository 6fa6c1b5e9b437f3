"""`pentimento run --material`: which goals and options the command line takes together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pentimento.cli.main import main
from pentimento.contracts.codec import to_plain
from pentimento.contracts.images import write_png
from pentimento.control.commission import ClayGoal, read_clay_commission
from pentimento.control.run_sculpture import PREVIEW
from tests.bundle.tiny_bundle import write_tiny_bundle
from tests.control.sculpting_bundle import add_clay


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--material", "foam"], "give --material and a goal: --letter, --goal-mesh, --goal-heights or --goal-image"),
        (["--letter", "A"], "--letter: to sculpt, give --material and a goal"),
        (["--material", "foam", "--letter", "A", "--up", "y"], "--up is for --goal-mesh"),
        (["--material", "foam", "--goal-mesh", "a.stl", "--font", "a.ttf"], "--font is for --letter"),
        (
            ["--material", "foam", "--letter", "A", "--strokes", "3"],
            "is sculpted without --strokes",
        ),
        (["--material", "foam", "--letter", "A", "--goal-mesh", "a.stl"], "not allowed with"),
        (["--material", "foam", "--goal-mesh", "a.stl", "--up", "w"], "invalid choice: 'w'"),
        (["--material", "foam", "--letter", "A", "--raised", "4"], "has no unit"),
        (["--material", "foam", "--letter", "A", "--raised", "0 mm"], "is not above 0"),
        (["--raised", "4 mm"], "--raised: to sculpt, give --material and a goal"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    options: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["run", "bundle", "--out", str(tmp_path / "s"), *options])
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_a_picture_is_sculpted(tmp_path: Path) -> None:
    picture = np.full((30, 30, 3), 220, np.uint8)
    picture[10:20, 10:20] = 30
    write_png(tmp_path / "face.png", picture)
    add_clay(write_tiny_bundle(tmp_path / "bundle"))
    given = ["--material", "foam", "--goal-image", str(tmp_path / "face.png"), "--pushes", "1"]
    assert main(["run", str(tmp_path / "bundle"), "--out", str(tmp_path / "s"), *given]) == 0
    commission = read_clay_commission(tmp_path / "s")
    assert commission is not None
    assert to_plain(commission.goal) == to_plain(ClayGoal("image", str(tmp_path / "face.png")))
    assert (tmp_path / "s" / PREVIEW).is_file()


def test_a_bundle_says_what_it_can_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = add_clay(write_tiny_bundle(tmp_path / "bundle"))
    assert main(["bundle", str(folder)]) == 0
    said = capsys.readouterr().out
    assert f"{folder} is whole" in said and "--material foam: " in said and "--setting " in said
    (folder / "manifest.json").write_bytes((folder / "manifest.json").read_bytes()[:-9])
    assert main(["bundle", str(folder)]) == 1
