"""`make repro PROFILE=sculpting`: every material with every end-effector."""

from pentimento.report.page import ReportConfig, ReportInputs, build_report
from pipelines._config import load_section
from pipelines._imports import ROOT
from pipelines._params import overlaid, read_yaml, sections_of
from pipelines.collect_pushes import CollectPushes
from pipelines.sculpt import Sculpt

PARAMS = ROOT / "params.yaml"
PIPELINE = read_yaml(ROOT / "profiles/sculpting/pipeline.yaml")
(MATERIALS,) = (each["materials"] for each in PIPELINE["vars"] if "materials" in each)


def test_its_stages_are_those_of_the_default_pipeline() -> None:
    default = read_yaml(ROOT / "dvc.yaml")["stages"]
    for name, stage in PIPELINE["stages"].items():
        assert stage["outs"] == default[name]["outs"]
        assert stage["params"] == sections_of(name, overlaid(ROOT, "sculpting")) or name == "report"
        assert stage["cmd"] == default[name]["cmd"] or name == "report"


def test_it_has_each_material_with_each_end_effector_once() -> None:
    collection = load_section(PARAMS, "collect_pushes", CollectPushes)
    settings = load_section(PARAMS, "sculpt", Sculpt).settings
    pairs = {(settings[name].world, settings[name].end_effector) for name in MATERIALS}
    assert len(pairs) == len(MATERIALS) == 12
    assert {len({pair[side] for pair in pairs}) for side in (0, 1)} == {3, 4}
    for name, setting in settings.items():
        assert setting.end_effector == collection.end_effector[name], "a push model is of one end-effector"
        assert setting.world == collection.world.get(name, name)


def test_the_default_pipeline_has_three_of_them() -> None:
    (materials,) = (each["materials"] for each in read_yaml(ROOT / "dvc.yaml")["vars"] if "materials" in each)
    assert set(materials) < set(MATERIALS)
    assert len({load_section(PARAMS, "sculpt", Sculpt).settings[name].end_effector for name in materials}) == 3


def test_a_report_needs_no_strokes() -> None:
    config = load_section(PARAMS, "report", ReportConfig)
    nothing = ReportInputs(
        paintings=[], tools=[], benchmarks=None, meanings=(), duet=None, diagnoses=[], plans=[], handwriting=None,
        evaluations=[], sculptures=[], performances=(),
    )  # fmt: skip
    page = build_report(nothing, config)["index.html"].decode()
    assert 'id="tools"' not in page and "From pushes: a model of each material" in page
