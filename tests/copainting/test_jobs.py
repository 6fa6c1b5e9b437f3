"""Worker processes, scratch folders and keyed generators."""

import math
from pathlib import Path

import pytest
import torch

from pentimento.copainting.jobs import gather, generator_for, scratch_folder, worker_pool


@pytest.mark.parametrize("workers", [1, 2])
def test_jobs_return_results_in_order_for_any_number_of_processes(workers: int) -> None:
    with worker_pool(workers, int) as submit:
        assert gather([submit(math.factorial, n) for n in range(8)]) == [math.factorial(n) for n in range(8)]


@pytest.mark.parametrize("workers", [1, 2])
def test_failure_of_a_job_is_raised(workers: int) -> None:
    with pytest.raises(ValueError), worker_pool(workers, int) as submit:
        gather([submit(math.sqrt, -1.0)])


def test_scratch_folder_depends_on_settings_and_inputs() -> None:
    root = Path("scratch")
    first = scratch_folder(root, "fit", {"a": 1, "b": 2.5}, {"data": "x"})
    assert first == scratch_folder(root, "fit", {"b": 2.5, "a": 1}, {"data": "x"})
    others = [
        scratch_folder(root, "fit", {"a": 2, "b": 2.5}, {"data": "x"}),
        scratch_folder(root, "fit", {"a": 1, "b": 2.5}, {"data": "y"}),
        scratch_folder(root, "other", {"a": 1, "b": 2.5}, {"data": "x"}),
    ]
    assert len({first, *others}) == 4


def test_generators_of_neighbouring_keys_are_uncorrelated() -> None:
    keys = [(0, 0), (0, 1), (1, 0), (0, 1, 0), (1, 1)]
    drawn = [torch.randn(4000, generator=generator_for(*key)) for key in keys]
    correlation = torch.corrcoef(torch.stack(drawn)) - torch.eye(len(keys))
    assert float(correlation.abs().max()) < 0.1
    assert torch.equal(drawn[1], torch.randn(4000, generator=generator_for(0, 1)))
