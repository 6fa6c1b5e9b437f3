import argparse
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import PentimentoError
from pipelines._io import output_folder, stage_main, write_json


def run_stage(body: str, *arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", stage(body), *arguments],
        cwd=cwd,
        env=environment(),
        capture_output=True,
        text=True,
    )


def stage(body: str) -> str:
    head = """
        import argparse, time
        from pathlib import Path
        from pentimento.contracts.errors import PentimentoError
        from pipelines._io import output_folder, stage_main
        parser = argparse.ArgumentParser(prog="toy")
        parser.add_argument("--out", type=Path, required=True)
        def main(arguments):
            with output_folder(arguments.out) as folder:
                (folder / "part").write_text("new")
    """
    inside = textwrap.indent(textwrap.dedent(body).strip(), " " * 8)
    return f"{textwrap.dedent(head)}{inside}\nstage_main(main, parser)"


def environment() -> dict[str, str]:
    root = Path(__file__).parents[2]
    return os.environ | {"PYTHONPATH": f"{root}{os.pathsep}{root / 'src'}"}


@pytest.mark.parametrize(
    ("body", "status", "sentence"),
    [
        ("pass", 0, ""),
        ("raise PentimentoError('The brush is\\nmissing.')", 1, "toy: The brush is missing.\n"),
        ("open('absent/photo.png')", 1, "toy: cannot find absent/photo.png; run `make repro`"),
        (
            "raise OSError(28, 'No space left on device')",
            1,
            "toy: No space left on device at out; nothing half-written",
        ),
        ("raise MemoryError('Unable to allocate 9 TiB')", 1, "toy: memory is exhausted (Unable to allocate"),
        ("raise KeyboardInterrupt", 130, ""),
    ],
)
def test_a_failure_is_one_sentence_and_the_old_output_stays(
    tmp_path: Path, body: str, status: int, sentence: str
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "part").write_text("old")
    done = run_stage(body, "--out", "out", cwd=tmp_path)
    assert done.returncode == status
    assert done.stderr.startswith(sentence)
    assert len(done.stderr.splitlines()) == (1 if sentence else 0)
    assert (out / "part").read_text() == ("new" if status == 0 else "old")
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


def test_wrong_usage_exits_with_2(tmp_path: Path) -> None:
    assert run_stage("pass", cwd=tmp_path).returncode == 2


def test_sigterm_removes_the_scratch_and_sigkill_leaves_it_to_the_next_execution(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for number, left in [(signal.SIGTERM, 0), (signal.SIGKILL, 1)]:
        process = subprocess.Popen(
            [sys.executable, "-c", stage("time.sleep(60)"), "--out", str(out)], env=environment()
        )
        deadline = time.monotonic() + 20
        while not list(tmp_path.glob(".out.*/part")) and time.monotonic() < deadline:
            time.sleep(0.01)
        process.send_signal(number)
        process.wait()
        assert len(list(tmp_path.iterdir())) == left
    assert run_stage("pass", "--out", str(out), cwd=tmp_path).returncode == 0
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


def test_json_is_equal_for_equal_values(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"b": np.float32(0.5), "a": np.arange(2), "c": {"x": (0.1 + 0.2, None, "é")}})
    write_json(tmp_path / "b.json", {"c": {"x": [0.3, None, "é"]}, "a": [0, 1], "b": 0.5})
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert json.loads((tmp_path / "a.json").read_text()) == {
        "a": [0, 1],
        "b": 0.5,
        "c": {"x": [0.3, None, "é"]},
    }


def test_json_refuses_what_is_no_number(tmp_path: Path) -> None:
    with pytest.raises(PentimentoError, match=r"metrics\.json: loss is nan"):
        write_json(tmp_path / "metrics.json", {"loss": float("nan")})
    assert not list(tmp_path.iterdir())


def test_output_folder_makes_its_parents(tmp_path: Path) -> None:
    with output_folder(tmp_path / "data/strokes/marker") as folder:
        (folder / "x").touch()
    assert (tmp_path / "data/strokes/marker/x").exists()


def test_stage_main_exits_with_0(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["toy"])
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as caught:
        stage_main(lambda _: None, argparse.ArgumentParser(prog="toy"))
    assert caught.value.code == 0
