"""`make repro`: run DVC, restore outputs that a failure left missing, print where the report is.

    python -m pipelines._repro [PROFILE] [--json] [--stage STAGE]

On a terminal a table shows how the stages are doing, and the report opens in the browser, where there is one. Where the
output is no terminal, the stages' own lines are printed. With `--json` every line is a JSON object.

A profile (`profiles/<name>.yaml`) overlays params.yaml. It runs in `.profiles/<name>/`, a copy of the files that git
tracks or would add, with the same DVC cache and MLflow store, so that the working tree stays clean. Where there is a
`profiles/<name>/pipeline.yaml`, its stages run in place of those of dvc.yaml.

With `--stage`, only that stage (`paint`) or stage item (`paint@colour`) runs, and what it reads as far as out of date.
"""

import argparse
import filecmp
import os
import shutil
import subprocess
import sys
import time
import webbrowser
from collections.abc import Callable
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from pentimento.contracts.errors import ConfigError, PentimentoError
from pipelines._deps import name_files
from pipelines._dvc import put_aside_broken_lock, run_dvc
from pipelines._io import end_with_parent
from pipelines._params import Params, overlaid, read_yaml
from pipelines._progress_views import View, opened_view
from pipelines._review.agreement import link
from pipelines._review.champions import register
from pipelines._review.view import address_of
from pipelines._side_by_side import bring_up_to_date, items_of
from pipelines._tracking.dvc_files import locked_stages
from pipelines._tracking.store import VARIABLE
from pipelines._tracking.timings import TIMINGS

_OWN_FILES = {"dvc.lock", "params.yaml"}  # a profile's copy has its own
_MANIFEST = Path(".pentimento/overlaid.txt")
STATUS = {0: "FINISHED", 130: "KILLED", 143: "KILLED"}  # of MLflow, by exit status


def main(arguments: list[str]) -> int:
    """Return the exit status of `make repro`."""
    parser = argparse.ArgumentParser(
        prog="make repro", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("profile", nargs="?", metavar="PROFILE")
    parser.add_argument("--json", action="store_true", help="print each line as a JSON object")
    parser.add_argument("--stage", help="a stage, or stage@item, instead of all")
    asked = parser.parse_args(arguments)
    end_with_parent()
    with opened_view(asked.json) as view:
        return _run(Path.cwd(), asked.profile, asked.stage, view)


def _run(root: Path, profile: str | None, stage: str | None, view: View) -> int:
    os.environ.setdefault("MLFLOW_TRACKING_URI", f"sqlite:///{root / 'mlflow.db'}")
    os.environ["PENTIMENTO_PROFILE"] = profile or "default"
    try:
        folder = overlay(root, profile) if profile else root
        put_aside_broken_lock(folder)
        name_files_of(folder, view.note)
        targets = items_of(stage, folder) if stage else []
    except (PentimentoError, OSError) as error:
        print(f"make repro: {error}", file=sys.stderr)
        view.end(1, None)
        return 1
    started = time.time()
    execution = f"{profile or 'default'} · {time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(started))}"
    os.environ[VARIABLE] = execution
    try:
        status, unfinished = bring_up_to_date(folder, view, targets)
    except KeyboardInterrupt:  # no stage had begun
        status, unfinished = 130, frozenset()
    ran = _ran_since(folder, started)
    experiments: dict[str, str] = {}
    try:
        if status != 0 or ran:
            experiments = link(folder, execution, STATUS.get(status, "FAILED"), unfinished)
            if status == 0 and profile is None:  # models of other profiles are not registered
                view.note("\n".join(["", *register(folder)]))
    except PentimentoError as error:  # the outputs are complete; only links in MLflow are missing
        print(f"make repro: {error}", file=sys.stderr)
    if status != 0:
        restore_missing(folder)
        view.end(status, None)
        print(
            "\nThe pipeline did not finish. Earlier outputs are in place; `make repro` goes on from here.",
            file=sys.stderr,
        )
        return status
    report = None if targets and "report" not in targets else folder / "data/report/index.html"
    view.note(f"\nThe report:  {report.relative_to(root)}" if report else "")
    store = os.environ["MLFLOW_TRACKING_URI"]
    view.note(f"The runs:    .venv/bin/mlflow ui --workers 1 --backend-store-uri {store}")
    view.note("             then open" + ("" if experiments else " http://127.0.0.1:5000"))
    for name, experiment in experiments.items():
        view.note(f"             http://127.0.0.1:5000/{address_of(experiment)} ({name})")
    view.note("What changed: .venv/bin/python -m pipelines.compare --last 2")
    view.end(0, report and report.relative_to(root))
    if ran and report:
        open_report(report)
    return 0


def open_report(page: Path) -> None:
    """Open the report in a browser with a window, where a person sits at a terminal; else do nothing."""
    shown = sys.platform in ("darwin", "win32") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if not (sys.stdout.isatty() and shown) or os.environ.get("CI"):
        return
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return  # there is none; the path is printed
    in_the_terminal = type(browser) is webbrowser.GenericBrowser  # such as lynx, which would take the terminal over
    if not in_the_terminal:
        browser.open(page.resolve().as_uri())


def name_files_of(folder: Path, note: Callable[[str], None]) -> None:
    """Let the stages depend on the files that params.yaml names, so that DVC notices when one has changed."""
    try:
        changed = name_files(folder)
    except (ConfigError, OSError, KeyError, TypeError, AttributeError, YAMLError):
        return  # of files that DVC cannot read either, DVC reports what is wrong
    if changed:
        note(f"make repro: the files that params.yaml names were written into {folder / 'dvc.yaml'} as dependencies.")


def _ran_since(folder: Path, started: float) -> bool:
    """Whether a stage has finished since `started` (a Unix time)."""
    return any(file.stat().st_mtime >= started for file in (folder / TIMINGS).glob("*.json"))


def restore_missing(folder: Path) -> None:
    """Restore missing outputs of dvc.lock from the cache: DVC deletes outputs before a stage runs."""
    locked = locked_stages(folder)
    if not locked:
        return
    stages = read_yaml(folder / "dvc.yaml").get("stages", {})
    missing = [
        out["path"]
        for name, stage in locked.items()
        for out in stage.get("outs", [])
        if name.partition("@")[0] in stages and not (folder / out["path"]).exists()
    ]
    if missing:
        run_dvc(["checkout", "--quiet", "--allow-missing", *missing], folder)


def overlay(root: Path, profile: str) -> Path:
    """Bring `.profiles/<profile>/` up to date and return it; its dvc.lock and outputs stay."""
    return overlay_with(root, profile, overlaid(root, profile), profile)


def overlay_with(root: Path, name: str, params: Params, profile: str | None) -> Path:
    """Bring `.profiles/<name>/` up to date, a copy of the repository with other parameters, and return it.

    Its dvc.lock and outputs stay. Its stages are those of the profile, where it has some of its own.
    """
    folder = root / ".profiles" / name
    _copy_changed(root, folder)
    if profile and (own := root / "profiles" / profile / "pipeline.yaml").is_file():
        shutil.copy2(own, folder / "dvc.yaml")
    with (folder / "params.yaml").open("w", encoding="utf-8") as file:
        YAML(typ="safe").dump(params, file)
    # The copy is no git repository. The cache is shared, so that a stage runs once for both.
    (folder / ".dvc/config.local").write_text(
        f"[core]\n    no_scm = true\n[cache]\n    dir = {root / '.dvc/cache'}\n", encoding="utf-8"
    )
    return folder


def _copy_changed(root: Path, folder: Path) -> None:
    """Copy the files that git tracks or would add, and remove copies of files that no longer exist."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode != 0:
        raise PentimentoError(f"git cannot list the files of {root} ({listed.stderr.strip()}); run in a git clone.")
    files = [name for name in listed.stdout.split("\0") if name and name not in _OWN_FILES and (root / name).is_file()]
    manifest = folder / _MANIFEST
    before = manifest.read_text(encoding="utf-8").splitlines() if manifest.is_file() else []
    for name in set(before) - set(files):
        (folder / name).unlink(missing_ok=True)
    for name in files:
        target = folder / name
        if not (target.is_file() and filecmp.cmp(root / name, target)):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, target)
    manifest.parent.mkdir(parents=True, exist_ok=True)
    manifest.write_text("\n".join(files), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
