"""The mutation study on a small project that tests half of its module."""

from pathlib import Path

import numpy as np
import pytest

from studies.mutants import mirrored_tests, results, sample

MODULE = Path("src/pentimento/clay/depth.py")


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in {
        MODULE: "def depth(a: int | None, b):\n    return a - b if a > b else 3 * b\n",
        mirrored_tests(MODULE): "from pentimento.clay.depth import depth\ndef test():\n    assert depth(3, 1) == 2\n",
        Path("src/pentimento/clay/untested.py"): "X = 1 + 1\n",
        Path("src/pentimento/clay/__init__.py"): "",
        Path("src/pentimento/__init__.py"): "",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "src"))
    return tmp_path


def test_tests_of_a_module_mirror_its_path() -> None:
    assert mirrored_tests(MODULE) == Path("tests/clay/test_depth.py")


@pytest.mark.usefixtures("project")
def test_sample_is_fixed_by_its_seed_and_has_one_mutation_a_place_of_tested_modules() -> None:
    one, again = (sample(100, np.random.default_rng(0)) for _ in range(2))
    assert one == again and {mutation.module_path for mutation in one} == {MODULE}
    places = [mutation.start_pos for mutation in one]
    assert len(set(places)) == len(places) == 5  # a - b, if, >, 3, 3 * b


def test_mutants_of_untested_code_survive_and_the_module_is_restored(project: Path) -> None:
    text = (project / MODULE).read_text()
    chosen = [m for m in sample(100, np.random.default_rng(0)) if "Binary" in m.operator_name]
    *lines, score = results(chosen)
    assert len(lines) == 2
    assert any(line.startswith("killed") and "a - b" in line for line in lines)
    assert any(line.startswith("survived") and "3 * b" in line for line in lines)
    assert score.startswith("1 of 2 mutants killed (50%)")
    assert (project / MODULE).read_text() == text


def test_module_whose_tests_fail_is_not_scored(project: Path) -> None:
    (project / mirrored_tests(MODULE)).write_text("def test():\n    assert False\n")
    assert list(results(sample(1, np.random.default_rng(0))))[-1].startswith("0 of 0 mutants killed")
