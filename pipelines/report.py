"""Write the report on the outputs of the other stages."""

import argparse
from dataclasses import asdict
from pathlib import Path

from pentimento.report.benchmarks import read_benchmarks
from pentimento.report.by_meaning import read_meanings
from pentimento.report.copainting import read_copainting
from pentimento.report.diagnoses import read_diagnosis
from pentimento.report.duet import read_duet
from pentimento.report.files import read_json
from pentimento.report.handwriting import read_handwriting
from pentimento.report.page import ReportConfig, ReportInputs, build_report
from pentimento.report.paintings import read_painting
from pentimento.report.performances import read_performances
from pentimento.report.plans import read_painting_plan
from pentimento.report.sculpting import read_sculpture
from pentimento.report.tools import read_tool
from pipelines._config import load_section
from pipelines._io import output_folder, single_threaded, stage_main
from pipelines._tracking import tracked_run


def main(arguments: argparse.Namespace) -> None:
    """Write `--out`: index.html, and its pictures as files beside it."""
    config = load_section(Path("params.yaml"), "report", ReportConfig)
    single_threaded()
    strokes = {tool: arguments.strokes / tool for tool in arguments.tools}
    weights = {tool: arguments.models / f"stroke_{tool}_base/weights" for tool in arguments.tools}
    gaps = {tool: arguments.gap / tool for tool in arguments.tools}
    plans = {tool: arguments.plans / tool for tool in arguments.planned}
    paintings = {setting: arguments.paintings / setting for setting in arguments.settings}
    evaluations = {setting: arguments.evaluations / setting for setting in arguments.evaluated}
    sculptures = {name: arguments.sculptures / name for name in arguments.sculpted}
    push_models = {name: arguments.models / f"push_{name}_base/weights" for name in arguments.sculpted}
    push_gaps = {name: arguments.gap / f"push_{name}" for name in arguments.sculpted}
    drawings = {setting: arguments.hands / setting for setting in arguments.drawn}
    inputs = {f"strokes.{tool}": path for tool, path in strokes.items()}
    inputs |= {f"model.{tool}": path for tool, path in weights.items()}
    inputs |= {f"gap.{tool}": path for tool, path in gaps.items()}
    inputs |= {f"plan.{tool}": path for tool, path in plans.items()}
    inputs |= {f"painting.{setting}": path for setting, path in paintings.items()}
    inputs |= {f"evaluation.{setting}": path for setting, path in evaluations.items()}
    inputs |= {f"sculpture.{material}": path for material, path in sculptures.items()}
    inputs |= {f"push_model.{material}": path for material, path in push_models.items()}
    inputs |= {f"gap.push_{material}": path for material, path in push_gaps.items()}
    inputs |= {f"hands.{setting}": path for setting, path in drawings.items()}
    single = {
        "paintings_by_meaning": arguments.meanings,
        "subjects_in_hands": arguments.subjects,
        "trajvae": arguments.models / "trajvae/weights" if drawings else None,
        "demonstrations": arguments.demonstrations,
        "performances": arguments.performances,
        "duet": arguments.duet,
        "benchmarks": arguments.benchmarks,
    }
    inputs |= {name: path for name, path in single.items() if path is not None}
    with tracked_run("report", None, asdict(config), inputs) as run, output_folder(arguments.out) as out:
        report_inputs = ReportInputs(
            paintings=[read_painting(setting, folder) for setting, folder in paintings.items()],
            tools=[read_tool(tool, strokes[tool], weights[tool], config.strokes) for tool in arguments.tools],
            benchmarks=read_benchmarks(arguments.benchmarks) if arguments.benchmarks else None,
            meanings=read_meanings(arguments.meanings) if arguments.meanings else (),
            duet=read_duet(arguments.duet) if arguments.duet else None,
            diagnoses=[read_diagnosis(tool, gap, recorded=_is_recorded(strokes[tool])) for tool, gap in gaps.items()],
            plans=[read_painting_plan(tool, folder) for tool, folder in plans.items()],
            handwriting=read_handwriting(
                drawings, arguments.subjects, arguments.models / "trajvae/weights", arguments.demonstrations
            )
            if drawings
            else None,
            evaluations=[read_copainting(setting, folder) for setting, folder in evaluations.items()],
            sculptures=[
                read_sculpture(name, folder, push_models[name], push_gaps[name]) for name, folder in sculptures.items()
            ],
            performances=read_performances(arguments.performances) if arguments.performances else (),
        )
        files = build_report(report_inputs, config)
        for name, data in files.items():
            (out / name).write_bytes(data)
        run.log("page_bytes", len(files["index.html"]))


def _is_recorded(strokes: Path) -> bool:
    """Whether the strokes in a folder of the stage collect_strokes come from a recorded table."""
    return bool(read_json(strokes / "metrics.json").get("recorded", False))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="report", description=__doc__, epilog="What is not given has no section on the page."
    )
    parser.add_argument("--strokes", type=Path, help="folder of a table of strokes for each tool")
    parser.add_argument("--models", required=True, type=Path)
    parser.add_argument("--gap", required=True, type=Path, help="folder of a diagnosis for each tool")
    parser.add_argument("--plans", type=Path, help="folder of a plan for each recorded tool")
    parser.add_argument("--paintings", type=Path)
    parser.add_argument("--meanings", type=Path, help="paintings by meaning")
    parser.add_argument("--duet", type=Path, help="the sheet that was drawn in turns")
    parser.add_argument("--evaluations", type=Path, help="folder of an evaluation for each setting")
    parser.add_argument("--performances", type=Path, help="what the bundle painted")
    parser.add_argument("--sculptures", type=Path, help="folder of a sculpture for each material")
    parser.add_argument("--hands", type=Path, help="drawings in handwriting styles")
    parser.add_argument("--subjects", type=Path, help="named things in handwriting styles")
    parser.add_argument("--demonstrations", type=Path)
    parser.add_argument("--benchmarks", type=Path, help="output of `make bench`")
    parser.add_argument("--tools", default=[], nargs="*", help="in the order in which the page shows them")
    parser.add_argument("--planned", default=[], nargs="*", help="tools with a plan, likewise")
    parser.add_argument("--settings", default=[], nargs="*", help="likewise; the first opens the page")
    parser.add_argument("--evaluated", default=[], nargs="*", help="settings of co-painting, likewise")
    parser.add_argument("--drawn", default=[], nargs="*", help="settings of handwriting, likewise")
    parser.add_argument("--sculpted", default=[], nargs="*", help="materials, likewise")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
