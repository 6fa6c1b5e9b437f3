"""The comparison in sentences, which the terminal and the page share."""

from pipelines._review.comparison import Comparison, Side, StageDifference
from pipelines._review.judgement import Figure

_SHOWN = 4  # names in a sentence


def number(value: float | None) -> str:
    """Four digits."""
    return "none" if value is None else f"{value:.4g}"


def with_interval(figure: Figure, side: int) -> str:
    """A value, and its interval where one is recorded."""
    value, interval = figure.values[side], figure.intervals[side]
    return number(value) + (f" [{interval[0]:.3g}, {interval[1]:.3g}]" if interval else "")


def of_side(side: Side) -> str:
    """When it ran, from which code, and how it ended."""
    code = f"commit {side.commit[:8]}" if side.commit else "no commit"
    uncommitted = " with uncommitted changes" if side.dirty else ""
    return f"{side.started}, profile {side.profile}, {code}{uncommitted}, {side.status.lower()}"


def what_changed(comparison: Comparison) -> list[str]:
    """Parameters, data and code, a sentence each."""
    stages = comparison.stages
    params = [f"{stage.name}: {name}" for stage in stages for name in stage.params]
    data = list(dict.fromkeys(path for stage in stages for path in stage.data))
    a, b = comparison.sides
    if a.commit != b.commit:
        code = f"The commit differs: {a.commit[:8] or 'none'} and {b.commit[:8] or 'none'}."
    else:
        code = f"The commit is the same ({a.commit[:8] or 'none'})."
    dirty = [name for name, side in zip("AB", (a, b), strict=True) if side.dirty]
    if dirty:
        code += f" {' and '.join(dirty)} ran with uncommitted changes, which no commit tells."
    return [_listed(params, "parameter", "differ"), _listed(data, "folder of data or models", "differ"), code]


def verdict(stage: StageDifference) -> str:
    """Of a stage's main figure, or of how many of its figures differ."""
    a, b = stage.runs
    if a is None or b is None:
        return f"only in {'A' if b is None else 'B'}"
    if a.id == b.id:
        return "the same run"
    if stage.same:
        return "nothing differs"
    if stage.headline is not None:
        return stage.headline.sentence
    changed = sum(figure.changed for figure in stage.figures)
    return f"{changed} of {len(stage.figures)} figures differ; the stage has no main figure"


def text(comparison: Comparison) -> str:
    """For the terminal."""
    lines = [f"{letter}  {side.title}  ({of_side(side)})" for letter, side in zip("AB", comparison.sides, strict=True)]
    lines += ["", *what_changed(comparison), ""]
    for stage in comparison.changed:
        lines.append(f"{stage.name}: {verdict(stage)}")
        lines += [f"    {name}: {a} -> {b}" for name, (a, b) in [*stage.params.items()][:_SHOWN]]
        if stage.headline is not None and stage.headline.changed:
            lines.append(
                f"    {stage.headline.name}: A {with_interval(stage.headline, 0)}, B {with_interval(stage.headline, 1)}"
            )
    same = [stage.name for stage in comparison.stages if stage.same]
    if same:
        lines.append(f"The same in both: {', '.join(same)}.")
    if comparison.origins:
        lines += ["", "On which data:"]
    for path, (one, other) in comparison.origins.items():
        lines.append(f"    {path}: {one}" if one == other else f"    {path}: A {one or 'none'} -> B {other or 'none'}")
    return "\n".join(lines)


def _listed(names: list[str], noun: str, verb: str) -> str:
    if not names:
        return f"No {noun} {verb}s."
    shown = ", ".join(names[:_SHOWN]) + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")
    plural = noun.replace("parameter", "parameters").replace("folder", "folders") if len(names) > 1 else noun
    return f"{len(names)} {plural} {verb if len(names) > 1 else verb + 's'}: {shown}."
