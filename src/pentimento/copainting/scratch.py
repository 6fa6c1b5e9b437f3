"""Where unfinished work is kept: a folder for each combination of settings and inputs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def scratch_folder(root: Path, name: str, params: Mapping[str, Any], digests: Mapping[str, str]) -> Path:
    """The folder of work `name` with these settings on inputs of these digests; another combination, another folder."""
    key = hashlib.sha256(json.dumps([params, digests], sort_keys=True, default=str).encode()).hexdigest()
    return root / name / key[:16]
