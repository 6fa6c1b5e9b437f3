"""A plan of many co-paintings as tables, for the terminal and as a self-contained HTML page."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from pentimento.report.templates import render
from pentimento.report.wording import count, decimal, percent
from pipelines._review.scale import CLUSTER, ON_A_CPU, ON_A_GPU, STAGE, FineTuning, Interval, Plan, Timing


class Table(NamedTuple):
    """Rows of plain text under a title, with notes."""

    title: str
    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    notes: tuple[str, ...]


def headline(plan: Plan) -> str:
    """Return the plan in one sentence."""
    priced = "" if plan.price is None else f", at a price of {_with_range(plan.cost(plan.machines), decimal)}"
    scaled = "" if plan.profile is None else f", scaled to profiles/{plan.profile}.yaml"
    return (
        f"{plan.paintings:,} co-paintings on {count(plan.machines, 'machine')} of {count(plan.cores, 'core')}{scaled}: "
        f"{_with_range(plan.wall_s(plan.machines), duration)}, {gigabytes(plan.kept_bytes())}{priced}."
    )


def tables(plan: Plan) -> list[Table]:
    """Return the tables of the plan."""
    tuning = [] if plan.fine_tunings is None else [_fine_tuning(plan.fine_tunings)]
    return [_measured(plan), _machines(plan), _serial(plan), *tuning, _space(plan), _laws(plan)]


def text(plan: Plan) -> str:
    """Return the plan for the terminal."""
    lines = [headline(plan)]
    for each in tables(plan):
        widths = [max(len(row[i]) for row in [each.head, *each.rows]) for i in range(len(each.head))]
        lines += ["", each.title]
        lines += [
            "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in [each.head, *each.rows]
        ]
        lines += [f"  {note}" for note in each.notes]
    return "\n".join(lines)


def page(plan: Plan) -> str:
    """Return the plan as a self-contained HTML page."""
    title = f"{plan.paintings:,} co-paintings"
    return render("scale.html", title=title, headline=headline(plan), tables=tables(plan))


def _measured(plan: Plan) -> Table:
    rates = plan.rates
    run = _origin(rates.timing)
    spread = f"{len(rates.shards_s)} of {count(rates.shards, 'shard')} of {run}, {count(rates.workers, 'worker')}"
    folder = f"pairs of {run}"
    return Table(
        "Measured rates",
        ("rate", "value", "from"),
        [
            ("core-seconds for a painting", _with_range(plan.painting_s(), decimal), spread),
            ("before workers paint", duration(rates.begin_s), run),
            ("after the last shard, for a painting", f"{decimal(1000 * rates.end_s / rates.paintings)} ms", run),
            ("pairs of a painting", decimal(rates.pairs / rates.paintings), folder),
            ("bytes of a pair", decimal(rates.bytes / rates.pairs), folder),
            (
                "overhead of a cluster",
                percent(rates.overhead.share),
                f"{CLUSTER}, {count(rates.overhead.workers, 'worker')}, {rates.overhead.finished}",
            ),
        ],
        (
            "In brackets: if all shards were like the fastest or like the slowest twentieth of those measured.",
            "Rates are of the machine that measured them, with whatever else it did meanwhile; another processor has "
            "others. The overhead is that of a cluster on one machine: a network between machines is not in it.",
        ),
    )


def _machines(plan: Plan) -> Table:
    powers = [2**k for k in range(plan.machines.bit_length() + 1)]
    shown = sorted({*powers, plan.machines})
    head = ["machines", "painting", "the rest", "together", "times as fast"]
    rows = [
        [
            str(machines),
            duration(plan.sharded_s(machines).mean),
            duration(plan.serial_s()),
            _with_range(plan.wall_s(machines), duration),
            decimal(plan.speed_up(machines)),
        ]
        for machines in shown
    ]
    notes = [
        "Painting is shared by all cores, as if each were as fast as those that were measured; the rest is done once, "
        "on one machine. No number of machines is more than "
        f"{decimal(plan.wall_s(1).mean / plan.serial_s())} times as fast as one."
    ]
    if plan.price is not None:
        head.append("price")
        rows = [[*row, _with_range(plan.cost(machines), decimal)] for row, machines in zip(rows, shown, strict=True)]
        notes.append(
            f"At {decimal(plan.price)} for a machine and hour: all of them while they paint, one for the rest."
        )
    return Table("Time by the number of machines", tuple(head), [tuple(row) for row in rows], tuple(notes))


def _serial(plan: Plan) -> Table:
    origin = _origin(plan.rates.timing)
    rows = [(timing.name, duration(timing.seconds), _origin(timing)) for timing in plan.rates.serial]
    rows += [
        (f"{STAGE}: before workers paint", duration(plan.rates.begin_s), origin),
        (
            f"{STAGE}: scoring and keeping pairs",
            duration(plan.keeping_s()),
            f"{origin}, in proportion to the paintings",
        ),
    ]
    return Table(
        "What does not shard",
        ("stage", "time", "from"),
        rows,
        (
            "Stages are counted as they ran here, one after the other, at the sizes that params.yaml had: with more "
            "scenes or other models they take other times. make repro runs two at a time.",
        ),
    )


def _fine_tuning(measured: tuple[FineTuning, ...]) -> Table:
    rows = [(each.device, duration(each.seconds), gigabytes(each.memory_bytes), each.source) for each in measured]
    missing = [
        f"Not measured on {device}: run `python -m studies.{study}`."
        for device, study, file in (("a CPU", "published_sizes", ON_A_CPU), ("a GPU", "on_a_gpu", ON_A_GPU))
        if not any(str(file) in each.source for each in measured)
    ]
    return Table(
        "Fine-tuning at the published size, in the profile's steps",
        ("on", "time, at most", "memory", "from"),
        rows,
        (
            *missing,
            "Not in the times above, which count this stage as it ran here. The memory is that of the measured batch; "
            "encoding the pairs and scoring come on top of the time.",
        ),
    )


def _space(plan: Plan) -> Table:
    return Table(
        "Space",
        ("what", "size", "from"),
        [
            ("pairs on disk", gigabytes(plan.kept_bytes()), f"{plan.pairs():,.0f} pairs at the measured bytes"),
            (
                "their pictures, decoded",
                gigabytes(plan.memory_bytes()),
                f"two of {plan.sizes.picture_pixels} pixels a pair, of which fine-tuning holds a few hundred at a time",
            ),
        ],
        ("DVC's cache holds the pairs again where its file system cannot share blocks, and a remote once more.",),
    )


def _laws(plan: Plan) -> Table:
    one, wanted, measured = plan.factors, plan.sizes, plan.rates.sizes
    return Table(
        "What would change it",
        ("size", "measured at", "planned for", "factor", "law"),
        [
            (
                "strokes",
                f"{measured.strokes}",
                f"{wanted.strokes}",
                decimal(one.strokes),
                "time in proportion: assumed, and at most (docs/scale.md)",
            ),
            (
                "pixels of the plan",
                f"{measured.pixels}",
                f"{wanted.pixels}",
                decimal(one.pixels),
                "time in proportion: assumed, and at most (docs/scale.md)",
            ),
            (
                "iterations",
                decimal(measured.iterations),
                decimal(wanted.iterations),
                decimal(one.iterations),
                "time in proportion: measured once (docs/scale.md)",
            ),
            (
                "pixels of a picture",
                f"{measured.picture_pixels}",
                f"{wanted.picture_pixels}",
                decimal(one.picture_pixels),
                "bytes, and time after the last shard, in proportion: assumed, and at most",
            ),
        ],
        (
            f"It is planned for the sizes {_whose(plan)}.",
            "The encoder that guides plans is not in these laws: a larger one than the measured run's takes longer.",
        ),
    )


def _origin(timing: Timing) -> str:
    return f"run {timing.run[:8]}, {timing.finished}"


def _whose(plan: Plan) -> str:
    return "that were measured" if plan.profile is None else f"of profiles/{plan.profile}.yaml"


def duration(seconds: float) -> str:
    """Format a duration: 3.2 h, 12 min, 45 s."""
    if seconds >= 3600:
        return f"{decimal(seconds / 3600)} h"
    return f"{decimal(seconds / 60)} min" if seconds >= 60 else f"{decimal(seconds)} s"


def gigabytes(size: float) -> str:
    """Format a number of bytes in units of 10^9."""
    return f"{decimal(size / 1e9)} GB"


def _with_range(interval: Interval, form: Callable[[float], str]) -> str:
    return f"{form(interval.mean)} [{form(interval.low)}, {form(interval.high)}]"
