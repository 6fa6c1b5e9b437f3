"""Everything that reads a file from outside, each with a sound file to begin with."""

from __future__ import annotations

import copy
import hashlib
import io
import json
import shutil
import struct
from collections.abc import Callable
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import trimesh

from pentimento.bundle.onnx_header import read_header
from pentimento.bundle.reader import open_bundle
from pentimento.contracts import pushes, strokes
from pentimento.contracts.errors import ContractError, PentimentoError
from pentimento.contracts.images import decode_png, encode_png, read_image
from pentimento.contracts.plan import Plan, PlanHeader, PlannedStroke, read_plan, write_plan
from pentimento.contracts.schema import TableContract
from pentimento.contracts.tables import read_table
from pentimento.diagnosis.strokes.quarantine import usable_rows
from pentimento.dynamics.pushes.measured import load_pushes
from pentimento.dynamics.strokes.traj2stroke import Traj2StrokeParameters, read_parameters
from pentimento.goals3d.sources import height_file_relief, mesh_relief
from pentimento.io.lerobot_in import Description, import_lerobot
from pentimento.io.lerobot_out import export_lerobot
from pentimento.io.photo_pairs import import_photo_pairs
from pentimento.io.stroke_rows import Placement
from pentimento.robots.rig import load_rig
from pentimento.robots.tools import load_end_effector, load_tool
from pentimento.studio.clay.world import load_clay_world
from pentimento.studio.strokes.world import WORLDS, load_world
from pipelines._config import load_section
from pipelines.collect_strokes import CollectStrokes
from studies.fuzz.mutate import mutated
from studies.fuzz.recordings import recordings
from studies.fuzz.target import Target, through_file

ROOT = Path(__file__).resolve().parents[2]
_SHEET_MM = (60, 40)


def targets(folder: Path, bundle: Path | None) -> list[Target]:
    """All readers; ``folder`` is theirs to write into. Without a bundle, none is altered."""
    folder.mkdir(parents=True, exist_ok=True)
    return [
        *_tables(folder),
        *_pictures(folder),
        *_settings(folder),
        *_records(folder),
        *_goals(folder),
        *_imports(folder),
        *recordings(folder),
        *_datasets(folder / "datasets"),
        *([] if bundle is None else _bundles(folder, bundle)),
    ]


def _tables(folder: Path) -> list[Target]:
    def strokes_of(path: Path) -> Any:
        return usable_rows(read_table(path, strokes.CONTRACT).table)

    def pushes_of(path: Path) -> Any:
        return load_pushes(read_table(path, pushes.CONTRACT).table)

    return [
        Target("strokes.parquet", (_parquet(strokes),), through_file(folder / "strokes.parquet", strokes_of)),
        Target("pushes.parquet", (_parquet(pushes),), through_file(folder / "pushes.parquet", pushes_of)),
        Target("values of strokes", (_parquet(strokes),), _poisoned(strokes, folder / "rows.parquet", strokes_of)),
        Target("values of pushes", (_parquet(pushes),), _poisoned(pushes, folder / "rows.parquet", pushes_of)),
    ]


def _parquet(module: Any) -> bytes:
    written = io.BytesIO()
    pq.write_table(module.example_table(3), written, compression="zstd")
    return written.getvalue()


def _poisoned(module: Any, path: Path, read: Callable[[Path], Any]) -> Callable[[bytes], Any]:
    """Altered values in place of an altered layout: which, is drawn by the altered bytes."""
    contract: TableContract = module.CONTRACT
    sound, intact = module.example_table(3), _parquet(module)
    rows = sound.to_pylist()

    def attempt(data: bytes) -> Any:
        if data == intact:
            path.write_bytes(data)
            return read(path)
        rng = np.random.default_rng(int.from_bytes(hashlib.sha256(data).digest()[:8]))
        worse = copy.deepcopy(rows)
        for _ in range(int(rng.integers(1, 4))):
            row, column = worse[rng.integers(len(worse))], contract.columns[rng.integers(len(contract.columns))]
            row[column.name] = _worse(row[column.name], rng)
        try:
            pq.write_table(pa.Table.from_pylist(worse, schema=sound.schema), path)
        except (pa.ArrowException, TypeError, ValueError, OverflowError):
            raise ContractError("No such table can be written: the values do not fit their columns.") from None
        return read(path)

    return attempt


def _worse(value: Any, rng: np.random.Generator) -> Any:
    if isinstance(value, dict):
        return value | {"bytes": mutated(value["bytes"], rng)} if rng.random() < 0.7 else None
    if isinstance(value, list) and value and rng.random() < 0.8:
        worse = list(value)
        at = int(rng.integers(len(worse)))
        worse[at] = _worse(worse[at], rng)
        return worse if rng.random() < 0.8 else worse[: int(rng.integers(len(worse) + 1))]
    if isinstance(value, float | int):
        return (
            type(value)(0) if rng.random() < 0.2 else rng.choice([np.nan, np.inf, -value, 1e30, -1e-30, value * 1000])
        )
    return rng.choice(["", "nan", "x" * 1000, "\x00"]) if isinstance(value, str) else None


def _pictures(folder: Path) -> list[Target]:
    rng = np.random.default_rng(0)
    colour = encode_png(rng.integers(0, 256, (12, 16, 3)).astype(np.uint8))
    heights = encode_png(rng.integers(0, 2**16, (12, 16)).astype(np.uint16))
    jpeg = bytes(cv2.imencode(".jpg", rng.integers(0, 256, (12, 16, 3)).astype(np.uint8))[1].tobytes())
    return [
        Target("PNG in a table", (colour, heights), decode_png),
        Target("picture file", (colour, jpeg), through_file(folder / "picture", read_image)),
    ]


def _settings(folder: Path) -> list[Target]:
    for name in ("plain.toml", "table.toml"):
        shutil.copy(WORLDS / name, folder)
    for path in (WORLDS.parents[1] / "clay" / WORLDS.name).glob("*.toml"):
        shutil.copy(path, folder)

    def packaged(package: str, kind: str) -> tuple[bytes, ...]:
        found = sorted((resources.files(package) / kind).iterdir(), key=lambda entry: entry.name)
        return tuple(entry.read_bytes() for entry in found if entry.name.endswith(".toml"))

    def section(path: Path) -> Any:
        return load_section(path, "collect_strokes", CollectStrokes)

    # table.toml is no whole world: others are written over it.
    worlds = tuple(path.read_bytes() for path in sorted(WORLDS.glob("*.toml")) if path.name != "table.toml")
    clay = ((WORLDS.parents[1] / "clay" / WORLDS.name / "foam.toml").read_bytes(),)
    params = (ROOT / "params.yaml").read_bytes().partition(b"\ntrain_stroke_dynamics")[0]
    return [
        Target("params.yaml", (params,), through_file(folder / "params.yaml", section)),
        Target("tool", packaged("pentimento.robots", "tools"), through_file(folder / "tool.toml", load_tool)),
        Target("rig", packaged("pentimento.robots", "rigs"), through_file(folder / "rig.toml", load_rig)),
        Target(
            "end-effector", packaged("pentimento.robots", "end_effectors"),
            through_file(folder / "end_effector.toml", load_end_effector),
        ),
        Target("world", worlds, through_file(folder / "world.toml", load_world)),
        Target("clay world", clay, through_file(folder / "clay.toml", load_clay_world)),
    ]  # fmt: skip


def _records(folder: Path) -> list[Target]:
    path = np.column_stack(
        [np.linspace(0, 1, 4), np.linspace(0.02, 0.04, 4), np.full(4, 0.02), np.full(4, -1e-3), np.zeros(4)]
    )
    header = PlanHeader("marker", np.zeros((1, 3)), (0.06, 0.04), "envelope")
    write_plan(folder / "plan.jsonl", Plan(header, (PlannedStroke(path, np.zeros(3), dip=False),) * 2))
    model = json.dumps(asdict(Traj2StrokeParameters((1.0, 1.0), (0.0, 0.0), 1.0, 0.001, 0.3, 0.9))).encode()
    return [
        Target("plan", ((folder / "plan.jsonl").read_bytes(),), through_file(folder / "altered.jsonl", read_plan)),
        Target("stroke model", (model,), through_file(folder / "parameters.json", read_parameters)),
    ]


def _goals(folder: Path) -> list[Target]:
    written = io.BytesIO()
    np.save(written, np.random.default_rng(0).uniform(0, 0.01, (8, 8)), allow_pickle=False)
    mesh = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 2 3 4\n"
    ply = (
        b"ply\nformat %s 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
    )
    ply += b"property list uchar int vertex_indices\nend_header\n"
    corners = np.array([(0, 0, 1), (2, 0, 1), (2, 1, 0), (0, 1, 0)], "<f4")
    binary = corners.tobytes() + b"".join(struct.pack("<B3i", 3, *face) for face in ((0, 1, 2), (0, 2, 3)))
    plain = b"0 0 1\n2 0 1\n2 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"
    plies = (ply % b"ascii" + plain, ply % b"binary_little_endian" + binary)
    box = trimesh.creation.box()
    stls = (box.export(file_type="stl"), box.export(file_type="stl_ascii").encode())
    return [
        Target("PLY mesh", plies, through_file(folder / "mesh.ply", lambda path: mesh_relief(path, 16))),
        Target("STL mesh", stls, through_file(folder / "mesh.stl", lambda path: mesh_relief(path, 16))),
        Target("height map", (written.getvalue(),), through_file(folder / "relief.npy", height_file_relief)),
        Target("mesh", (mesh,), through_file(folder / "mesh.obj", lambda path: mesh_relief(path, 16))),
    ]


def _imports(folder: Path) -> list[Target]:
    photos = folder / "photos"
    photos.mkdir(exist_ok=True)
    paper = encode_png(np.full((_SHEET_MM[1] * 2, _SHEET_MM[0] * 2, 3), 240, np.uint8))
    for name in ("a_before", "a_after", "b_before", "b_after"):
        (photos / f"{name}.png").write_bytes(paper)
    place = Placement.parsed(None, "2 px/mm", False)
    points = "stroke,t_s,x_mm,y_mm,z_mm,yaw_deg,session,color,humidity\n" + "".join(
        f"{name},{0.1 * at:.1f},{20 + 2 * at},{15 + at},-1,10,monday,#101020,0.4\n" for name in "ab" for at in range(4)
    )
    csv = folder / "paths.csv"

    def from_paths(path: Path) -> Any:
        return import_photo_pairs(path, photos, place, "quill", folder / "imported")

    alone = "".join(line for line in points.splitlines(keepends=True) if not line.startswith("b"))

    def from_photo(data: bytes) -> Any:
        csv.write_text(alone)
        (photos / "a_after.png").write_bytes(data)
        try:
            return import_photo_pairs(csv, photos, place, "quill", folder / "imported")
        finally:
            (photos / "a_after.png").write_bytes(paper)

    return [
        Target("imported paths", (points.encode(),), through_file(csv, from_paths)),
        Target("imported photograph", (paper,), from_photo),
    ]


def _datasets(folder: Path) -> list[Target]:
    """A LeRobot dataset of ours, and the same without what it says of its rows: as it could be anybody's."""
    folder.mkdir(exist_ok=True)
    rows, episodes = folder / "rows.parquet", Path("meta/episodes/chunk-000/file-000.parquet")
    pq.write_table(strokes.example_table(2), rows)
    export_lerobot(rows, folder / "ours", 10)
    shutil.copytree(folder / "ours", folder / "theirs", dirs_exist_ok=True)
    said = pq.read_table(folder / "ours" / episodes)
    plain = said.select([name for name in said.column_names if not name.startswith("pentimento")])
    pq.write_table(plain, folder / "theirs" / episodes)
    description = Description(Placement.parsed("0 mm, 0 mm, 300 mm, 210 mm", None, False), "quill", 1.0, None, None)

    def altered(whose: str, description: Description | None, name: Path) -> Target:
        path = folder / whose / name
        sound = path.read_bytes()

        def attempt(data: bytes) -> Any:
            path.write_bytes(data)
            try:
                return import_lerobot(folder / whose, description, folder / "imported")
            finally:
                path.write_bytes(sound)

        return Target(f"LeRobot dataset: {whose}/{name}", (sound,), attempt)

    names = (Path("meta/info.json"), episodes, Path("data/chunk-000/file-000.parquet"))
    return [altered(whose, what, name) for whose, what in (("ours", None), ("theirs", description)) for name in names]


def _bundles(folder: Path, bundle: Path) -> list[Target]:
    """Each file of a bundle, altered by itself: the whole is refused by who knows its digest."""
    copied = folder / "bundle"
    shutil.copytree(bundle, copied, dirs_exist_ok=True)
    digest = open_bundle(copied).digest
    names = sorted(str(path.relative_to(copied)) for path in copied.rglob("*") if path.is_file())

    def altered(name: str) -> Target:
        sound = (bundle / name).read_bytes()

        def attempt(data: bytes) -> Any:
            (copied / name).write_bytes(data)
            try:
                if (
                    name != "manifest.json"
                ):  # a changed manifest has another digest; without a known digest it cannot be detected
                    _refused(lambda: open_bundle(copied))
                return open_bundle(copied, digest)
            finally:
                (copied / name).write_bytes(sound)

        return Target(f"bundle: {name}", (sound,), attempt, must_refuse=True)

    def manifest_alone(data: bytes) -> Any:
        sound = (bundle / "manifest.json").read_bytes()
        (copied / "manifest.json").write_bytes(data)
        try:
            return open_bundle(copied)
        finally:
            (copied / "manifest.json").write_bytes(sound)

    graphs = tuple((bundle / name).read_bytes() for name in names if name.endswith(".onnx"))[:2]
    return [
        *(altered(name) for name in names),
        Target("manifest whose digest nobody knows", ((bundle / "manifest.json").read_bytes(),), manifest_alone),
        Target("ONNX header", graphs, read_header),
    ]


class SilentlyAccepted(Exception):
    """An altered file passed where none may."""


def _refused(opened: Callable[[], Any]) -> None:
    try:
        opened()
    except PentimentoError:
        return
    raise SilentlyAccepted
