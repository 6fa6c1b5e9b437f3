"""Write the report on the outputs of the other stages."""

import argparse
from dataclasses import asdict
from pathlib import Path

from pentimento.report.benchmarks import read_benchmarks
from pentimento.report.by_meaning import read_meanings
from pentimento.report.copainting import read_copainting
from pentimento.report.diagnoses import read_diagnosis
from pentimento.report.handwriting import read_handwriting
from pentimento.report.page import ReportConfig, ReportInputs, build_report
from pentimento.report.paintings import read_painting
from pentimento.report.performances import read_performances
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
    paintings = {setting: arguments.paintings / setting for setting in arguments.settings}
    inputs = {f"strokes.{tool}": path for tool, path in strokes.items()}
    inputs |= {f"model.{tool}": path for tool, path in weights.items()}
    inputs |= {f"gap.{tool}": arguments.gap / tool for tool in arguments.tools}
    inputs |= {f"painting.{setting}": path for setting, path in paintings.items()}
    inputs |= {"paintings_by_meaning": arguments.meanings}
    inputs |= {f"evaluation.{setting}": arguments.evaluations / setting for setting in arguments.evaluated}
    sculpted = {name: arguments.models / f"push_{name}_base/weights" for name in arguments.sculpted}
    inputs |= {f"sculpture.{material}": arguments.sculptures / material for material in sculpted}
    inputs |= {f"push_model.{material}": path for material, path in sculpted.items()}
    inputs |= {f"gap.push_{material}": arguments.gap / f"push_{material}" for material in sculpted}
    drawings = {setting: arguments.hands / setting for setting in arguments.drawn}
    inputs |= {f"hands.{setting}": path for setting, path in drawings.items()}
    inputs |= {"subjects_in_hands": arguments.subjects}
    inputs |= {"trajvae": arguments.models / "trajvae/weights"}
    inputs |= {"demonstrations": arguments.demonstrations}
    inputs |= {"performances": arguments.performances, "benchmarks": arguments.benchmarks}
    with tracked_run("report", None, asdict(config), inputs) as run, output_folder(arguments.out) as out:
        report_inputs = ReportInputs(
            paintings=[read_painting(setting, folder) for setting, folder in paintings.items()],
            tools=[read_tool(tool, strokes[tool], weights[tool], config.strokes) for tool in arguments.tools],
            benchmarks=read_benchmarks(arguments.benchmarks),
            meanings=read_meanings(arguments.meanings),
            diagnoses=[read_diagnosis(tool, arguments.gap / tool) for tool in arguments.tools],
            handwriting=read_handwriting(
                drawings, arguments.subjects, arguments.models / "trajvae/weights", arguments.demonstrations
            ),
            evaluations=[read_copainting(setting, arguments.evaluations / setting) for setting in arguments.evaluated],
            sculptures=[
                read_sculpture(name, arguments.sculptures / name, folder, arguments.gap / f"push_{name}")
                for name, folder in sculpted.items()
            ],
            performances=read_performances(arguments.performances),
        )
        files = build_report(report_inputs, config)
        for name, data in files.items():
            (out / name).write_bytes(data)
        run.log("page_bytes", len(files["index.html"]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="report", description=__doc__)
    parser.add_argument("--strokes", required=True, type=Path, help="folder of a table of strokes for each tool")
    parser.add_argument("--models", required=True, type=Path)
    parser.add_argument("--gap", required=True, type=Path, help="folder of a diagnosis for each tool")
    parser.add_argument("--paintings", required=True, type=Path)
    parser.add_argument("--meanings", required=True, type=Path, help="paintings by meaning")
    parser.add_argument("--evaluations", required=True, type=Path, help="folder of an evaluation for each setting")
    parser.add_argument("--performances", required=True, type=Path, help="what the bundle painted")
    parser.add_argument("--sculptures", required=True, type=Path, help="folder of a sculpture for each material")
    parser.add_argument("--hands", required=True, type=Path, help="drawings in handwriting styles")
    parser.add_argument("--subjects", required=True, type=Path, help="named things in handwriting styles")
    parser.add_argument("--demonstrations", required=True, type=Path)
    parser.add_argument("--benchmarks", required=True, type=Path, help="output of `make bench`")
    parser.add_argument("--tools", required=True, nargs="+", help="in the order in which the page shows them")
    parser.add_argument("--settings", required=True, nargs="+", help="likewise; the first opens the page")
    parser.add_argument("--evaluated", required=True, nargs="+", help="settings of co-painting, likewise")
    parser.add_argument("--drawn", required=True, nargs="+", help="settings of handwriting, likewise")
    parser.add_argument("--sculpted", required=True, nargs="+", help="materials, likewise")
    parser.add_argument("--out", required=True, type=Path)
    stage_main(main, parser)
