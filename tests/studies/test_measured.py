"""The page about measured strokes."""

from typing import Any

import pytest

from pentimento.contracts.errors import ConfigError
from studies import measured


def verdict(*established: str) -> dict[str, Any]:
    entries = [
        {
            "cause": cause,
            "gain": 0.3,
            "gain_ci": [0.2, 0.4],
            "parameters": {"distance_m": {"value": 0.0119, "se": 0.0005}, "unseen": {"value": 0.0, "se": 0.0}},
            "rivals": ["latency"],
        }
        for cause in established
    ]
    left = [{"mode": "width", "covariate": "press_m", "p": 0.001, "generic_gain": 0.1}]
    return {
        "rows": 100, "established": entries, "suspected": [], "mse": {"base": 0.02, "extended": 0.01},
        "unexplained": left,
        "resampled": [
            {"established": ["bristle_lag"], "suspected": []}, {"established": [], "suspected": ["bristle_lag"]},
            {"established": [], "suspected": []},
        ],
    }  # fmt: skip


def test_brushes_and_pens_are_counted_by_what_is_established() -> None:
    page = measured.page([("brush_a", verdict("bristle_lag")), ("brush_b", verdict()), ("marker_c", verdict())])
    assert "Of 2 sets of brushes, `bristle_lag` is established on 1 (brush_a)" in page
    assert "neither cause is established on\n1 of 1 sets (marker_c)" in page


def test_a_row_says_number_error_rival_and_gain() -> None:
    page = measured.page([("brush_a", verdict("bristle_lag"))])
    assert "`bristle_lag` (distance_m 0.0119 ± 0.0005; rivals latency) 1, 2 of 3" in page
    assert "30% (20% to 40%)" in page
    assert "unseen" not in page


def test_without_the_folder_it_says_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PENTIMENTO_MEASURED", raising=False)
    monkeypatch.setattr("sys.argv", ["measured"])
    with pytest.raises(ConfigError, match="PENTIMENTO_MEASURED"):
        measured.main()
