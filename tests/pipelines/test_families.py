"""Every stage has its place, and the main figures are named as stages log them."""

import pytest

from pipelines._imports import ROOT
from pipelines._params import read_yaml
from pipelines._review.figures import less_is_better
from pipelines._tracking.families import FAMILIES, HEADLINES, OTHER, experiment_of, experiments, family_of

STAGES = list(read_yaml(ROOT / "dvc.yaml")["stages"])


@pytest.mark.parametrize("stage", STAGES)
def test_every_stage_is_of_one_family(stage: str) -> None:
    assert sum(stage in stages for stages in FAMILIES.values()) == 1, f"name {stage} in pipelines/_tracking/families.py"
    assert experiment_of(stage) == f"pentimento/{family_of(stage)}" in experiments()


def test_what_is_no_stage_is_of_no_family() -> None:
    assert family_of("a_stage_of_tomorrow") == OTHER


@pytest.mark.parametrize("stage", HEADLINES)
def test_a_main_figure_has_a_direction_and_its_names_stand_in_the_stage(stage: str) -> None:
    """The last parts of the names are texts or fields in the code that the stage runs."""
    headline = HEADLINES[stage]
    assert less_is_better(headline.metric) is not None
    assert headline.baseline != headline.metric
    files = [file for folder in ("pipelines", "src/pentimento") for file in (ROOT / folder).rglob("*.py")]
    code = "".join(file.read_text() for file in files if file.name not in ("families.py", "judgement.py"))
    for name in filter(None, (headline.metric, headline.baseline)):
        missing = [part for part in name.split(".") if part not in code]
        assert not missing, f"{stage}: nothing logs {missing} of {name}"
