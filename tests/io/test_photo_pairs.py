"""Tests of the import of paths in a CSV file with pairs of photographs."""

import math
import unicodedata
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from pentimento.cli.main import main
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.contracts.images import decode_png, write_png
from pentimento.contracts.strokes import CONTRACT
from pentimento.contracts.tables import read_table
from pentimento.io.photo_pairs import import_photo_pairs
from pentimento.io.stroke_rows import Placement
from tests.io.photographed import SHEET_MM, line_mm, photograph, record, sheet, written

WINDOW = "0 mm, 0 mm, 120 mm, 8 cm"
PLACE = Placement.parsed(WINDOW, None, False)


def ink_centre_m(row: dict) -> np.ndarray:
    """Where the photographs changed, x and y in the canvas frame."""
    before, after = (decode_png(row[name]["bytes"]).astype(float) for name in ("before", "after"))
    rows, columns = np.nonzero(np.abs(after - before).sum(-1) > 100)
    x_min, _, x_max, y_max = row["window_m"]
    k = before.shape[1] / (x_max - x_min)
    return np.array([x_min + (columns.mean() + 0.5) / k, y_max - (rows.mean() + 0.5) / k])


def test_converts_units_and_aligns_ink_with_the_path(tmp_path: Path) -> None:
    imported = import_photo_pairs(record(tmp_path, 6), tmp_path / "photos", PLACE, "quill", tmp_path / "out")
    assert imported.rows == 6 and not imported.refused
    rows = read_table(tmp_path / "out", CONTRACT).table.to_pylist()
    for number, row in enumerate(rows):
        path = np.array(row["path"])
        np.testing.assert_allclose(path[:, 1:3], line_mm(number) / 1000, atol=1e-6)
        np.testing.assert_allclose(path[:, 3], -0.001 * (1 + 0.1 * (number % 4)), rtol=1e-5)
        np.testing.assert_allclose(path[:, 4], math.pi / 6, rtol=1e-6)
        np.testing.assert_allclose(ink_centre_m(row), path[:, 1:3].mean(0), atol=4e-4)
        assert row["tool"] == "quill" and row["session"] == "paths" and row["order"] == row["action_id"] == number
        np.testing.assert_allclose(row["color_srgb"], [20 / 255, 20 / 255, 30 / 255], rtol=1e-6)
        assert row["window_m"][2] - row["window_m"][0] < 0.05  # what lies around the path, not the whole sheet


def test_an_imported_table_is_read_as_the_guide_says(tmp_path: Path) -> None:
    import_photo_pairs(record(tmp_path, 6), tmp_path / "photos", PLACE, "quill", tmp_path / "out")
    assert {file.name for file in (tmp_path / "out").glob("[!.]*")} >= {"README.md", "contact_sheet.png"}
    table = pq.read_table(sorted((tmp_path / "out").glob("*.parquet")))
    assert table.num_rows == 6 and set(table.column_names) >= {"path", "before", "after"}


def test_finds_photographs_as_cameras_and_other_systems_name_them(tmp_path: Path) -> None:
    names = ("S0", "é", "s2")
    for number, name in enumerate(names):
        photograph(tmp_path / "photos", name, line_mm(number, 2))
    (tmp_path / "photos/S0_after.png").rename(tmp_path / "photos/S0_after.PNG")
    decomposed = unicodedata.normalize("NFD", "é")
    assert decomposed != "é"
    (tmp_path / "photos/é_before.png").rename(tmp_path / f"photos/{decomposed}_before.png")
    (tmp_path / "photos/._s2_after.png").write_bytes(b"of macOS")
    rows = [f"{name},{x},{y},-1" for number, name in enumerate(names) for x, y in line_mm(number, 2)]
    paths = written(tmp_path, ["stroke,x_mm,y_mm,z_mm", *rows])
    imported = import_photo_pairs(paths, tmp_path / "photos", PLACE, "quill", tmp_path / "out")
    assert imported.rows == 3 and not imported.refused
    (tmp_path / "photos/s2_after.jpg").write_bytes((tmp_path / "photos/s2_after.png").read_bytes())
    imported = import_photo_pairs(paths, tmp_path / "photos", PLACE, "quill", tmp_path / "two")
    assert imported.refused == {"there are several photographs after it": ["s2"]}


def test_a_photograph_of_a_phone_s_own_format_is_named(tmp_path: Path) -> None:
    paths = record(tmp_path, 2)
    (tmp_path / "photos/s0_after.png").rename(tmp_path / "photos/s0_after.HEIC")
    (tmp_path / "photos/s1_after.heic").write_bytes(b"beside the JPEG of the same shot")
    imported = import_photo_pairs(paths, tmp_path / "photos", PLACE, "quill", tmp_path / "out")
    assert imported.rows == 1
    assert imported.refused == {"the photograph after it is HEIC, which is not read: save it as JPEG or PNG": ["s0"]}


def test_photographs_are_read_as_they_look(tmp_path: Path) -> None:
    """An EXIF orientation, transparent paper and colours of another profile give the rows of the plain photographs."""
    paths = record(tmp_path, 2)
    import_photo_pairs(paths, tmp_path / "photos", PLACE, "quill", tmp_path / "plain")
    exif = Image.Exif()
    exif[0x0112] = 6
    for name in ("s0_before", "s0_after"):
        with Image.open(tmp_path / f"photos/{name}.png") as picture:
            picture.transpose(Image.Transpose.ROTATE_90).save(tmp_path / f"photos/{name}.png", exif=exif)
    for name in ("s1_before", "s1_after"):
        with Image.open(tmp_path / f"photos/{name}.png") as picture:
            pixels = np.dstack([np.asarray(picture), np.full(picture.size[::-1], 255, np.uint8)])
        pixels[:5] = 0  # black and transparent
        Image.fromarray(pixels).save(tmp_path / f"photos/{name}.png")
    imported = import_photo_pairs(paths, tmp_path / "photos", PLACE, "quill", tmp_path / "out")
    assert imported.rows == 2
    rows, plain = (read_table(tmp_path / name, CONTRACT).table.to_pylist() for name in ("out", "plain"))
    assert [row["after"] for row in rows] == [row["after"] for row in plain]
    with Image.open(tmp_path / "photos/s0_after.png") as picture:
        picture.convert("CMYK").save(tmp_path / "photos/s0_after.tif")
    (tmp_path / "photos/s0_after.png").unlink()
    imported = import_photo_pairs(paths, tmp_path / "photos", PLACE, "quill", tmp_path / "inks")
    assert imported.refused == {"a photograph is unreadable (colour mode CMYK)": ["s0"]}


@pytest.mark.parametrize("name", ["", "Unnamed: 0", "index"])
def test_a_column_that_numbers_the_points_is_passed_over(tmp_path: Path, name: str) -> None:
    paths = record(tmp_path, 2)
    first, *lines = paths.read_text().splitlines()
    rows = [f"{name},{first}", *(f"{number},{line}" for number, line in enumerate(lines))]
    imported = import_photo_pairs(written(tmp_path, rows), tmp_path / "photos", PLACE, "quill", tmp_path / "out")
    assert imported.rows == 2 and not imported.refused
    empty = [f"{first},,", *(f"{line},," for line in lines)]
    assert import_photo_pairs(written(tmp_path, empty), tmp_path / "photos", PLACE, "quill", tmp_path / "e").rows == 2
    notes = [f"{first},", *(f"{line},wet" for line in lines)]
    with pytest.raises(ContractError, match="2 × a column has no name"):
        import_photo_pairs(written(tmp_path, notes), tmp_path / "photos", PLACE, "quill", tmp_path / "notes")


def test_y_down_and_scale_give_equal_rows(tmp_path: Path) -> None:
    upright = record(tmp_path, 4)
    lines = upright.read_text().splitlines()
    turned = [lines[0]]
    for line in lines[1:]:
        fields = line.split(",")
        fields[3], fields[5] = f"{SHEET_MM[1] - float(fields[3]):.3f}", f"-{fields[5]}"
        turned.append(",".join(fields))
    tables = []
    for name, rows, place in (
        ("up", lines, PLACE),
        ("down", turned, Placement.parsed(WINDOW, None, True)),
        ("scale", turned, Placement.parsed(None, "5 px/mm", True)),
    ):
        import_photo_pairs(written(tmp_path, rows), tmp_path / "photos", place, "quill", tmp_path / name)
        tables.append(read_table(tmp_path / name, CONTRACT).table.to_pylist())
    for other in tables[1:]:
        for row, same in zip(tables[0], other, strict=True):
            np.testing.assert_allclose(row["path"], same["path"], atol=2e-6)
            np.testing.assert_allclose(row["window_m"], same["window_m"], atol=1e-6)
            assert row["before"] == same["before"] and row["after"] == same["after"]


def test_y_down_window_has_its_origin_at_the_lower_edge(tmp_path: Path) -> None:
    place = Placement.parsed("10 mm, 5 mm, 130 mm, 85 mm", None, True)
    assert place.window_m((400, 600)) == pytest.approx((0.01, 0.0, 0.13, 0.08))
    top = place.to_canvas(np.array([[0.0, 0.02, 0.005, 0.0, 0.3]]), (400, 600))
    np.testing.assert_allclose(top, [[0.0, 0.02, 0.08, 0.0, -0.3]])


def test_keeps_contract_columns_and_other_numbers_as_covariates(tmp_path: Path) -> None:
    photograph(tmp_path / "photos", "a", line_mm(0, 2))
    (x0, y0), (x1, y1) = line_mm(0, 2)
    header = "stroke,x_mm,y_mm,z_mm,session,action_id,since_reload,t_start_s,humidity"
    rows = [header, f"a,{x0},{y0},-1,monday,7,2,12.5,0.4", f"a,{x1},{y1},-1,monday,7,2,12.5,0.4"]
    import_photo_pairs(written(tmp_path, rows), tmp_path / "photos", PLACE, "quill", tmp_path / "out")
    (row,) = read_table(tmp_path / "out", CONTRACT).table.to_pylist()
    assert (row["session"], row["action_id"], row["since_reload"], row["t_start_s"]) == ("monday", 7, 2, 12.5)
    assert row["humidity"] == pytest.approx(0.4) and all(math.isnan(point[0]) for point in row["path"])


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (["a,0,30,20,-1,", "a,1,40,20,-1,"], "no photograph before"),
        (["s0,0,30,20,-1,"], "fewer than 2 points"),
        (["s0,0,30,20,-1,", "s0,1,nan,20,-1,"], "NaN or infinite"),
        (["s0,0,30,20,-1,", "s0,1,abc,20,-1,"], "not all numbers"),
        (["s0,0,30,20,-1,", 's0,1,"40,5",20,-1,'], "not all numbers"),
        (["s0,0,30,20,-1,", "s0,1,40,20,−1,"], "not all numbers"),
        (["s0,0,30,20,-1,", "s0,1,40,5,20,-1,"], "another number of fields"),
        (["s0,1,30,20,-1,", "s0,0,40,20,-1,"], "times run backwards"),
        (["s0,0,30,20,-1,", "s0,,40,20,-1,"], "times at some points only"),
        (["s0,0,30,20,-1,", "s0,1,400,20,-1,"], "leaves the photograph"),
        (["s0,0,30,20,-1,x", "s0,1,40,20,-1,y"], "session changes"),
        (["s0,0,30,20,-1,", "s0,1,40,20"], "another number of fields"),
        (["../s0,0,30,20,-1,", "../s0,1,40,20,-1,"], "cannot be that of a file"),
        (["torn,0,30,20,-1,", "torn,1,40,20,-1,"], "photograph is unreadable"),
        (["small,0,30,20,-1,", "small,1,40,20,-1,"], "differ in size"),
    ],
)
def test_counts_unusable_stroke_and_imports_the_others(points: list[str], reason: str, tmp_path: Path) -> None:
    for name, line in (("good", line_mm(1, 2)), ("s0", line_mm(0)), ("torn", line_mm(0)), ("small", line_mm(0))):
        photograph(tmp_path / "photos", name, line)
    torn = (tmp_path / "photos/torn_after.png").read_bytes()
    (tmp_path / "photos/torn_after.png").write_bytes(torn[: len(torn) // 2])
    write_png(tmp_path / "photos/small_after.png", sheet()[:-5])
    good = [f"good,{at},{x},{y},-1," for at, (x, y) in enumerate(line_mm(1, 2))]
    paths = written(tmp_path, ["stroke,t_s,x_mm,y_mm,z_mm,session", *points, *good])
    imported = import_photo_pairs(paths, tmp_path / "photos", PLACE, "quill", tmp_path / "out")
    assert imported.rows == 1
    ((said, names),) = imported.refused.items()
    assert reason in said and len(names) == 1
    assert reason in (tmp_path / "out/README.md").read_text()
    with pytest.raises(ContractError, match="None of the 1 strokes"):
        import_photo_pairs(
            written(tmp_path, ["stroke,t_s,x_mm,y_mm,z_mm,session", *points]),
            tmp_path / "photos", PLACE, "quill", tmp_path / "none",
        )  # fmt: skip
    assert not (tmp_path / "none").exists()


def test_two_recordings_one_behind_the_other_are_not_joined_to_one_stroke(tmp_path: Path) -> None:
    """Each numbers its strokes from 0, and has no times."""
    for number in range(2):
        photograph(tmp_path / "photos", str(number), line_mm(number, 2))
    names = ("0", "1", "0")
    rows = [f"{name},{x},{y},-1" for at, name in enumerate(names) for x, y in line_mm(at, 2)]
    paths = written(tmp_path, ["stroke,x_mm,y_mm,z_mm", *rows])
    imported = import_photo_pairs(paths, tmp_path / "photos", PLACE, "quill", tmp_path / "out")
    assert imported.rows == 1
    assert imported.refused == {"its points stand at several places of the file": ["0"]}


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("", "is empty"),
        ("stroke,t_s", "no column x, y, z .* such as x_mm"),
        ("stroke,x_mm,y_mm", "no column z .* such as z_mm"),
        ("stroke,t_s,x,y,z", "column 'x' has no unit"),
        ("stroke,x_mm,y_mm,z_mm,yaw", "column 'yaw' has no unit; name it with one, such as yaw_deg"),
        ("stroke,x_mm,y_mm,z_kg", "unusable unit"),
        ("stroke,x_mm,y_mm,z_mm,press_mm", "z and press"),
        ("stroke,x_mm,x_m,y_mm,z_mm", "x twice"),
        ("x_mm,y_mm,z_mm", "no column stroke"),
        ("stroke,x_mm,y_mm,z_mm", "no points"),
        ("stroke,stroke,x_mm,y_mm,z_mm", "two columns of one name"),
    ],
)
def test_rejects_malformed_table(header: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "paths.csv"
    path.write_text(f"{header}\n" if header else "")
    with pytest.raises(ContractError, match=says):
        import_photo_pairs(path, tmp_path, PLACE, "quill", tmp_path / "out")


def test_paths_beside_their_ink_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = record(tmp_path, 12)
    command = ["import", str(paths), "--photos", str(tmp_path / "photos"), "--window", WINDOW, "--tool", "quill"]
    assert main([*command, "--out", str(tmp_path / "right")]) == 0
    assert capsys.readouterr().err == ""
    assert main([*command, "--y-down", "--out", str(tmp_path / "mirrored")]) == 0
    warning = capsys.readouterr().err
    assert (
        "strokes have no ink within 2 mm of their paths" in warning and "--y-down" in warning and "--scale" in warning
    )


@pytest.mark.parametrize("window", ["", "0 mm, 0 mm, 1 mm", "0, 0, 1, 1", "0 mm, 0 mm, 0 mm, 1 mm", "a, b, c, d"])
def test_rejects_malformed_window(window: str) -> None:
    with pytest.raises(ConfigError, match=r"left, lower, right, upper"):
        Placement.parsed(window, None, False)


@pytest.mark.parametrize("scale", ["5", "0 px/mm", "5 mm"])
def test_rejects_malformed_scale(scale: str) -> None:
    with pytest.raises(ConfigError, match="px"):
        Placement.parsed(None, scale, False)


def test_command_prints_counts_and_reasons(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = record(tmp_path, 3)
    (tmp_path / "photos/s1_after.png").unlink()
    given = ["--photos", str(tmp_path / "photos"), "--window", WINDOW, "--tool", "quill", "--out", str(tmp_path / "o")]
    assert main(["import", str(paths), *given]) == 0
    said = capsys.readouterr().out
    assert "2 strokes are in" in said and "Refused: 1 × there is no photograph after it (s1)." in said
    assert main(["import", str(tmp_path / "nowhere.csv"), *given]) == 1
    assert "nowhere.csv" in capsys.readouterr().err


def test_command_deletes_nothing_that_it_did_not_write(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = record(tmp_path, 2)
    given = ["import", str(paths), "--photos", str(tmp_path / "photos"), "--window", WINDOW, "--tool", "quill", "--out"]
    assert main([*given, str(tmp_path / "out")]) == 0 and main([*given, str(tmp_path / "out")]) == 0
    assert main(["card", str(tmp_path / "out")]) == 0 and main([*given, str(tmp_path / "out")]) == 0
    before = sorted((tmp_path / "photos").iterdir())
    for out, says in (("photos", "did not write"), (".", "did not write"), ("paths.csv", "is a file")):
        capsys.readouterr()
        assert main([*given, str(tmp_path / out)]) == 1
        assert says in capsys.readouterr().err
    assert sorted((tmp_path / "photos").iterdir()) == before and paths.is_file()
    capsys.readouterr()
    assert main(["export", str(tmp_path / "out"), "--lerobot", str(tmp_path / "out")]) == 1
    assert "`pentimento export` did not write" in capsys.readouterr().err
    readme = tmp_path / "out/README.md"
    readme.write_text(f"---\nlicense: CC-BY-4.0\n---\n{readme.read_text()}")
    assert main([*given, str(tmp_path / "out")]) == 1
    assert "README.md, which was changed since" in capsys.readouterr().err
