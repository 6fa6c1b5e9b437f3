"""The comparison of two computers: none with itself, and every wrong result is seen."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.two_computers import KINDS, main
from tests.bundle.tiny_bundle import write_tiny_bundle


def test_a_computer_agrees_with_itself_and_not_with_wrong_results(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bundle, file = write_tiny_bundle(tmp_path / "bundle"), tmp_path / "reference.npz"
    assert main(["write", str(file), "--bundle", str(bundle)]) == 0
    assert main(["compare", str(file), "--bundle", str(bundle)]) == 0
    printed = capsys.readouterr().out
    assert "DIFFERS" not in printed and all(f"{kind} float64" in printed for kind in KINDS)
    with np.load(file) as kept:
        arrays = dict(kept.items())
    outputs = [name for name in arrays if name.startswith("output ")]
    assert any("pen_pull" in name for name in outputs)
    assert all(np.isfinite(arrays[name]).all() for name in outputs)
    for name in (
        f"output {KINDS[1]} float32, gradient of radius",
        next(name for name in outputs if "pen_pull" in name),
    ):
        wrong = arrays[name].copy()
        wrong.flat[wrong.size // 2] += 1.0
        np.savez(file, **(arrays | {name: wrong}))
        assert main(["compare", str(file), "--bundle", str(bundle)]) == 1
        (line,) = (line for line in capsys.readouterr().out.splitlines() if "DIFFERS" in line)
        assert name.removeprefix("output ") in line


def test_another_bundle_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bundle, file = write_tiny_bundle(tmp_path / "bundle"), tmp_path / "reference.npz"
    assert main(["write", str(file), "--bundle", str(bundle)]) == 0
    with np.load(file) as kept:
        np.savez(file, **(dict(kept.items()) | {"digest": np.array("0" * 64)}))
    assert main(["compare", str(file), "--bundle", str(bundle)]) == 1
    assert "it is another bundle" in capsys.readouterr().err
