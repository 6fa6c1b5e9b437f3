"""`pentimento new`; see docs/new_brush.md."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pentimento.cli.workshop import workshop

if TYPE_CHECKING:
    from pentimento.cli.scaffold.tool import Made


def add(commands: Any) -> None:
    """The subcommands ``new tool`` and ``new material``."""
    new = commands.add_parser("new", help="set up a new brush or material beside those that are there")
    kinds = new.add_subparsers(required=True, metavar="tool|material")
    tool = kinds.add_parser("tool", help="a brush or a pen")
    tool.add_argument("--like", required=True, metavar="TOOL", help="of the pipeline: what differs is learned")
    tool.add_argument(
        "--tool-file",
        type=Path,
        metavar="FILE",
        help="what the robot is told (TOML); by default what it is told of TOOL",
    )
    tool.set_defaults(run=_tool)
    material = kinds.add_parser("material", help="something to sculpt")
    material.add_argument("--like", required=True, metavar="MATERIAL", help="of the pipeline: what differs is learned")
    material.add_argument("--end-effector", metavar="NAME", help="what presses it; by default as for MATERIAL")
    material.set_defaults(run=_material)
    for kind in (tool, material):
        kind.add_argument("name", metavar="NAME", help="small letters, digits, underscores")
        kind.add_argument(
            "--world", type=Path, metavar="FILE", help="the studio's hidden truth (TOML); by default as of the other"
        )
        kind.add_argument(
            "--source", type=Path, metavar="TABLE", help="measured rows: Parquet in the contract, or a folder of shards"
        )


def _tool(arguments: argparse.Namespace) -> None:
    with workshop("set up a tool"):
        from pentimento.cli.scaffold.tool import new_tool

        made = new_tool(
            Path.cwd(), arguments.name, arguments.like, arguments.tool_file, arguments.world, arguments.source
        )
    _tell(arguments.name, arguments.like, made)
    print(
        f"""What to expect: collection, training, diagnosis and a painting take about five minutes on two cores.
Whether the strokes are enough: pentimento enough data/strokes/{arguments.name}
What they are, and what they cannot tell: pentimento card data/strokes/{arguments.name}
What the model gets wrong, and why: data/gap/{arguments.name}/report.html"""
    )


def _material(arguments: argparse.Namespace) -> None:
    with workshop("set up a material"):
        from pentimento.cli.scaffold.material import new_material

        made = new_material(
            Path.cwd(), arguments.name, arguments.like, arguments.end_effector, arguments.world, arguments.source
        )
    _tell(arguments.name, arguments.like, made)
    print("What to expect: collection, training, diagnosis and sculpting take about ten minutes on two cores.")


def _tell(name: str, like: str, made: Made) -> None:
    print(f"{name} is set up like {like}, in:")
    for path in made.files:
        print(f"  {path.relative_to(Path.cwd())}")
    for note in made.notes:
        print(note)
    print(
        f"""Read the first ones, and correct what differs. Then, with the others' models there (`make repro` once):
  dvc repro -s {" ".join(made.stages)}
and `make repro` for bundle and report; the others' stages run again once, because they depend on the same folders."""
    )
