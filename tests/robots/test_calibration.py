"""Calibrations on disk, and which of them let hardware move."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import CalibrationError
from pentimento.robots.calibration import (
    MAX_RESIDUAL,
    Calibration,
    calibrated,
    digest_of,
    fresh_calibrations,
    needed_kinds,
    read_calibration,
    require_fresh,
    write_calibration,
)
from tests.robots.machines import make_rig

RIG = make_rig()
NOW_S, DAY_S = 1.7e9, 86400.0
TOUCH = Calibration("touch", RIG.digest, NOW_S - 3600, "f" * 64, 1e-4, {"surface": [1e-3, 0.0, 2e-3]})


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = write_calibration(tmp_path, TOUCH)
    assert path.name == "touch.json" and read_calibration(tmp_path, "touch") == TOUCH


def test_a_fresh_one_of_this_rig_passes_up_to_its_age() -> None:
    require_fresh(TOUCH, RIG, NOW_S, DAY_S)
    require_fresh(TOUCH, RIG, NOW_S - 3600 + DAY_S, DAY_S)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"made_unix_s": NOW_S - DAY_S - 1}, "24.0 h old and at most 24.0 h"),
        ({"made_unix_s": NOW_S + 120}, "dated in the future"),
        ({"made_unix_s": math.nan}, "dated in the future"),
        ({"rig": "1" * 64}, "another rig than bench, or its file was changed"),
        ({"residual": 4e-4}, r"leaves 0\.0004 m and at most 0\.0003 m"),
        ({"residual": math.nan}, "leaves nan"),
        ({"residual": math.inf}, "leaves inf"),
        ({"residual": -1e-4}, "leaves -0.0001"),
    ],
)
def test_stale_foreign_or_inaccurate_calibration_is_rejected(change: dict[str, object], sentence: str) -> None:
    with pytest.raises(CalibrationError, match=sentence):
        require_fresh(dataclasses.replace(TOUCH, **change), RIG, NOW_S, DAY_S)  # type: ignore[arg-type]


def test_ages_below_two_hours_are_in_minutes() -> None:
    with pytest.raises(CalibrationError, match="is 60 min old and at most 1 min are allowed"):
        require_fresh(TOUCH, RIG, NOW_S, 60.0)
    with pytest.raises(CalibrationError, match=r"is 3\.0 h old and at most 90 min are allowed"):
        require_fresh(TOUCH, RIG, NOW_S + 7200, 5400.0)


@pytest.mark.parametrize("kind", MAX_RESIDUAL)
def test_each_kind_has_its_own_limit(kind: str) -> None:
    limit, _ = MAX_RESIDUAL[kind]  # type: ignore[index]
    at_limit = dataclasses.replace(TOUCH, kind=kind, residual=limit)  # type: ignore[arg-type]
    require_fresh(at_limit, RIG, NOW_S, DAY_S)
    with pytest.raises(CalibrationError, match="calibrate again"):
        require_fresh(dataclasses.replace(at_limit, residual=1.01 * limit), RIG, NOW_S, DAY_S)


def test_a_rig_without_a_file_has_no_fresh_calibration() -> None:
    with pytest.raises(CalibrationError, match="another rig"):
        require_fresh(dataclasses.replace(TOUCH, rig=""), make_rig(digest=""), NOW_S, DAY_S)


def test_a_rig_with_a_camera_needs_all_kinds(tmp_path: Path) -> None:
    write_calibration(tmp_path, TOUCH)
    assert fresh_calibrations(tmp_path, RIG, NOW_S, DAY_S) == {"touch": TOUCH}
    seeing = make_rig(camera=0)
    assert set(needed_kinds(seeing)) == {"lens", "canvas", "colour", "touch"}
    with pytest.raises(CalibrationError, match=r"no lens calibration .*; calibrate first"):
        fresh_calibrations(tmp_path, seeing, NOW_S, DAY_S)
    for kind in needed_kinds(seeing):
        write_calibration(tmp_path, dataclasses.replace(TOUCH, kind=kind))
    assert len(fresh_calibrations(tmp_path, seeing, NOW_S, DAY_S)) == 4
    write_calibration(tmp_path, dataclasses.replace(TOUCH, kind="canvas", made_unix_s=0.0))
    with pytest.raises(CalibrationError, match="canvas calibration is"):
        fresh_calibrations(tmp_path, seeing, NOW_S, DAY_S)


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "lens"},
        {"version": 2},
        {"residual": "small"},
        {"residual": True},
        {"values": [1]},
        {"more": 1},
        {"rig": None},
    ],
)
def test_a_file_that_is_no_such_calibration_is_refused(tmp_path: Path, change: dict[str, object]) -> None:
    path = write_calibration(tmp_path, TOUCH)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(CalibrationError, match="calibrate again"):
        read_calibration(tmp_path, "touch")
    path.write_text("{")
    with pytest.raises(CalibrationError, match="not readable"):
        read_calibration(tmp_path, "touch")


def test_nothing_that_is_no_number_gets_onto_disk(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        write_calibration(tmp_path, dataclasses.replace(TOUCH, residual=math.nan))
    assert list(tmp_path.iterdir()) == []


def test_the_found_surface_becomes_the_rig_s() -> None:
    assert calibrated(RIG, TOUCH).surface == (1e-3, 0.0, 2e-3)
    with pytest.raises(CalibrationError, match="no touch"):
        calibrated(RIG, dataclasses.replace(TOUCH, kind="lens"))


def test_digests_tell_type_shape_and_content_apart() -> None:
    a = np.arange(6.0)
    others = [a + 1e-12, a.reshape(2, 3), a.astype(np.float32), a[::-1]]
    assert len({digest_of(x) for x in (a, *others)}) == 5 and digest_of(a) == digest_of(a.copy())
    assert digest_of(a, a) != digest_of(np.concatenate((a, a)))
