"""The example of docs/diagnose_your_simulator.md: an arm in MuJoCo."""

from pathlib import Path

import numpy as np
import pytest

from examples.diagnose_your_simulator.arm import following, problem, problem_of
from examples.diagnose_your_simulator.robot import make_log
from pentimento.contracts.errors import ConfigError, ContractError
from pentimento.diagnosis.diagnose import diagnose


def test_the_hidden_fault_of_the_arm_is_named() -> None:
    log = make_log("link_mass", 4, 1.0)
    half = log["action"] % 2 == 0  # is enough, and takes half the time
    arm = problem_of({name: values[half] for name, values in log.items()}, 0)
    result = diagnose(arm, seed=0, log=lambda line: None)
    assert [finding.cause for finding in result.established] == ["link_mass"]
    value, error = result.established[0].values["log_mass"]
    assert value > max(0.1, 5 * error)  # the robot's link is heavier, and its centre of mass lies farther out


def test_play_delays_a_turn_by_its_width() -> None:
    there_and_back = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0, 50)])[None, :, None].repeat(2, axis=2)
    read = following(there_and_back, 0.1)
    assert read.max() == pytest.approx(0.9)
    assert read[0, -1, 0] == pytest.approx(0.1)
    np.testing.assert_array_equal(following(there_and_back, 0.0), there_and_back)


def test_wrong_files_and_faults_end_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no fault 'rust'"):
        make_log("rust", 0, 1.0)
    empty = tmp_path / "log.npz"
    empty.write_bytes(b"")
    with pytest.raises(ContractError, match="is no log of the arm"):
        problem(empty)
