"""How the study of late robots and lagging bristles counts."""

from studies.following import HIDDEN, STRENGTHS, is_right, summary


def line(way: str, hidden: tuple[str, ...], *causes: str) -> dict[str, object]:
    return {"world": 0, "way": way, "hidden": dict.fromkeys(hidden, 0.3), "causes": list(causes), "delay_s": None}


def test_a_world_is_right_if_both_answers_are() -> None:
    for hidden in HIDDEN:
        assert is_right(line("measured", hidden, *hidden, "path_scale"))
        for name in STRENGTHS:
            flipped = set(hidden) ^ {name}
            assert not is_right(line("measured", hidden, *flipped))


def test_summary_counts_by_what_is_hidden() -> None:
    lines = [
        line("measured", ("latency",), "latency"),
        line("commanded", ("latency",), "bristle_lag"),
        line("measured", (), "bristle_lag"),
    ]
    text = summary(lines)
    assert "| latency | 1 of 1 | 0 of 1 |" in text
    assert "| neither | 0 of 1 | 0 of 0 |" in text and "| all | 1 of 2 | 0 of 1 |" in text
