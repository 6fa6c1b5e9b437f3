"""A model becomes the champion where its held-out figure and the blind tests hold, and a bundle with its models."""

from pathlib import Path
from typing import Any

import pytest

from pipelines._review.agreement import read_lock
from pipelines._review.champions import register
from pipelines._tracking import tracked_run

PAGE = Path("docs/blind_tests.md")


@pytest.fixture
def client(stage_folder: Path) -> Any:
    """A store with nothing in it, and a repository with a table of strokes."""
    from mlflow import MlflowClient

    Path("dvc.yaml").write_text("stages: {diagnose_gap: {matrix: {tool: [marker]}}, deploy: {cmd: x}}\n")
    Path("data").mkdir()
    Path("data/strokes").write_text("strokes")
    PAGE.parent.mkdir()
    PAGE.write_text("| one cause | 5/6 | undecided |\n| two causes | 2/5 | **falls short** |\n")
    return MlflowClient()


def train(error: float, seed: int) -> list[str]:
    """The stage makes a model of that error, and DVC writes its lock; then what is new is registered."""
    Path("params.yaml").write_text(f"diagnose_gap: {{seed: {seed}}}\ndeploy: {{}}\n")
    with tracked_run("diagnose_gap", "marker", {"seed": seed}, {"strokes": Path("data/strokes")}) as run:
        run.log_metrics({"held_out": {"extended": {"mse": error}, "base": {"mse": 0.5}}})
    return _registered(seed)


def deploy(seed: int) -> list[str]:
    """The same for a bundle of the last model."""
    hands = Path("models/trajvae/weights")  # they are in the bundle and have no versions
    hands.mkdir(parents=True, exist_ok=True)
    inputs = {"stroke_marker": Path("models/stroke_marker/weights"), "hands": hands}
    with tracked_run("deploy", None, {"seed": seed}, inputs) as run:
        run.log_metrics({"largest_difference": 1e-6})
        run.tag("manifest", f"hash {seed}")
    return _registered(seed, f"b{seed}")


def _registered(seed: int, bundle: str = "") -> list[str]:
    Path("models/stroke_marker/weights").mkdir(parents=True, exist_ok=True)
    lines = [
        "stages:",
        "  diagnose_gap@marker:",
        f"    params: {{params.yaml: {{diagnose_gap: {{seed: {seed}}}}}}}",
        "    outs:",
        f'    - {{path: data/gap/marker, md5: "g{seed}"}}',
        f'    - {{path: models/stroke_marker/weights, md5: "m{seed}"}}',
    ]
    if bundle:
        lines += ["  deploy:", "    params: {params.yaml: {deploy: {}}}"]
        lines += [f'    outs: [{{path: models/bundle, md5: "{bundle}"}}]']
    Path("dvc.lock").write_text("\n".join(lines) + "\n")
    return register(Path.cwd())


def champion(client: Any, name: str = "stroke_marker") -> str:
    return str(client.get_model_version_by_alias(name, "champion").tags["md5"])


def test_the_alias_follows_the_held_out_figure(client: Any) -> None:
    assert train(0.3, 1) == ["stroke_marker: version 1 is the champion."]
    assert register(Path.cwd()) == []  # it is known
    (said,) = train(0.31, 2)
    assert said.startswith("stroke_marker: version 2 is not the champion: its held_out.extended.mse is 0.31, worse")
    assert champion(client) == "m1"
    assert train(0.29, 3) == ["stroke_marker: version 3 is the champion."]
    version = client.get_model_version_by_alias("stroke_marker", "champion")
    assert (version.source, version.tags["value"]) == ("dvc://m3/models/stroke_marker/weights", "0.29")
    assert version.tags["champion"] == "yes: not worse than version 1 with 0.3 on the same data"
    assert client.get_model_version("stroke_marker", "1").tags["champion"] == "yes: there was no champion"
    assert client.get_run(version.run_id).data.tags["stage"] == "diagnose_gap"


def test_the_alias_waits_where_the_blind_tests_fall_shorter_or_the_data_is_another(client: Any) -> None:
    train(0.3, 1)
    PAGE.write_text(PAGE.read_text() * 2)
    (said,) = train(0.2, 2)
    assert said.endswith("the blind tests fall short in 2 rows, and did in 1.")
    PAGE.write_text("| all | held |\n")
    Path("data/strokes").write_text("other strokes")
    (said,) = train(0.1, 3)
    assert "measured on other data" in said
    assert champion(client) == "m1"


def test_a_bundle_is_the_champion_with_its_models(client: Any) -> None:
    """Its version names the manifest, and its models are known by DVC's hashes."""
    train(0.3, 1)
    assert deploy(1) == ["bundle: version 1 is the champion."]
    version = client.get_model_version_by_alias("bundle", "champion")
    assert version.tags["manifest"] == "hash 1" == client.get_run(version.run_id).data.tags["manifest"]
    train(0.4, 2)
    assert deploy(2) == ["bundle: version 2 is not the champion: its stroke_marker is not the champion."]
    assert champion(client, "bundle") == "b1"


def test_entries_of_dvc_lock_that_dvc_yaml_no_longer_has_are_left_out(client: Any) -> None:
    """A stage that got a matrix leaves its old entry, without an item, in dvc.lock."""
    train(0.3, 1)
    lock = Path("dvc.lock")
    lock.write_text(
        lock.read_text() + "  diagnose_gap: {outs: []}\n  diagnose_gap@old: {outs: []}\n  gone: {outs: []}\n"
    )
    assert [locked.name for locked in read_lock(Path.cwd())] == ["diagnose_gap@marker"]
