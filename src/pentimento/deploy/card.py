"""The bundle's own card: what it is, what is in it, and what was measured; made with it, so that it cannot lag."""

from __future__ import annotations

from collections.abc import Mapping

from pentimento.bundle.manifest import GraphEntry, Setting

_HEAD = """# bundle

What a robot needs to paint beside a person, without PyTorch: stroke models with their gradients, image objectives with
theirs, the goal planner's parts, tools and safety envelopes. `manifest.json` lists every file with its size and
SHA-256; the runner checks all of it before it opens anything. What each part is good for, and what not, is said by the
cards of the models that it came from.

- **Made by** the stage `deploy`, which compared each graph with PyTorch and wrote the differences below.
- **Used by** `pentimento run`.
"""


def bundle_card(settings: Mapping[str, Setting], graphs: Mapping[str, GraphEntry], sizes: Mapping[str, int]) -> str:
    """Markdown."""
    lines = [_HEAD, "| setting | tool | canvas | strokes | envelope |", "|---|---|---|---|---|"]
    for name, setting in sorted(settings.items()):
        width, height = (1000 * length for length in setting.canvas_m)
        lines.append(
            f"| {name} | {setting.brush} | {width:g} x {height:g} mm | {setting.strokes} | {setting.envelope.id} |"
        )
    lines += [
        "",
        "The difference of a graph is the largest of its outputs' and of several examples': norm of the difference",
        "from PyTorch's over the norm of PyTorch's.",
        "",
        "| graph | from | kB | difference |",
        "|---|---|---|---|",
    ]
    for name, graph in sorted(graphs.items()):
        made_from = ", ".join(graph.models) or "fixed features"
        difference = max(graph.parity.values())
        lines.append(f"| {name} | {made_from} | {sizes[graph.file] / 1000:.1f} | {difference:.1e} |")
    return "\n".join(lines) + "\n"
