"""What dvc.lock says of each stage item."""

from dataclasses import dataclass
from pathlib import Path

from pipelines._config import read_yaml
from pipelines._tracking.digests import section_digest
from pipelines._tracking.dvc_lock import locked_stages


@dataclass(frozen=True)
class Locked:
    """A stage item as DVC last ran it, or found it in its cache."""

    stage: str
    item: str
    """Empty where the stage has no matrix."""
    inputs: dict[str, str]
    """MD5 by path, code included."""
    params_md5: str
    outputs: dict[str, str]
    """MD5 by path."""

    @property
    def name(self) -> str:
        """As DVC writes it."""
        return f"{self.stage}@{self.item}" if self.item else self.stage


def read_lock(folder: Path) -> list[Locked]:
    """Return the items of dvc.lock in `folder` whose stages are in dvc.yaml; none where nothing ran yet."""
    locked = locked_stages(folder)
    if not locked:
        return []
    stages = read_yaml(folder / "dvc.yaml").get("stages", {})
    made = []
    for name, entry in locked.items():
        stage, _, item = name.partition("@")
        if stage not in stages or (item and item not in _items(stages[stage].get("matrix", {}))):
            continue
        section = entry.get("params", {}).get("params.yaml", {}).get(stage)
        made.append(Locked(stage, item, _digests(entry, "deps"), section_digest(section), _digests(entry, "outs")))
    return made


def _items(matrix: dict[str, list[str]]) -> set[str]:
    """The pipeline's matrices have one axis each."""
    return {str(value) for values in matrix.values() for value in values}


def _digests(entry: dict[str, list[dict[str, str]]], part: str) -> dict[str, str]:
    return {each["path"]: str(each["md5"]) for each in entry.get(part, []) if "md5" in each}
