"""Results of a study as lines for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from pentimento.rating.answers import Answer
from pentimento.rating.page import Key
from pentimento.rating.results import Proportion, agreements, differences, matches, preferences


def result_lines(answers: Sequence[Answer], key: Key) -> list[str]:
    """What was counted and tested, in the form that the study has.

    Raises:
        ContractError: the answers are too few for any test.
    """
    raters, asked = len({answer.rater for answer in answers}), len(key.study.questions)
    lines = [f"{len(answers)} answers of {raters} raters to {asked} question{'s' * (asked > 1)}."]
    lines += {"choice": _choices, "match": _matches, "panel": _panel}[key.study.form](answers, key)
    if asked > 1:
        lines.append("Of so many tests, one in twenty is below .05 by chance; decide before which one counts.")
    return lines


def _choices(answers: Sequence[Answer], key: Key) -> list[str]:
    lines = []
    for one in preferences(answers, key):
        ties = ", ".join(f"{tie} {one.answers.get(tie, 0)}" for tie in key.study.ties)
        lines.append(f"{one.question}: {one.first} against {one.other}{f' ({ties})' if ties else ''}")
        lines.append(f"  of these answers  {_share(one.by_answer)}")
        lines.append(f"  by rater          {_share(one.by_rater)}")
        lines.append(f"  by item           {_share(one.by_item)}")
    return lines


def _matches(answers: Sequence[Answer], key: Key) -> list[str]:
    lines, width = [], max(map(len, key.conditions)) + 2
    for one in matches(answers, key):
        lines.append(f"{one.question}: matched {_share(one.right)}, where guessing finds 1 in {len(key.conditions)}")
        lines.append("".join(name.rjust(width) for name in ("", *key.conditions)) + "   (chosen)")
        for right, chosen in one.chosen.items():
            lines.append("".join(str(cell).rjust(width) for cell in (right, *chosen.values())))
    return lines


def _panel(answers: Sequence[Answer], key: Key) -> list[str]:
    lines = []
    for one in agreements(answers, key):
        means = ", ".join(f"{name} {mean:.2f}" for name, mean in one.means.items())
        lines += [
            f"{one.question}: mean {means}",
            f"  Cronbach's alpha of {one.raters} raters over {one.pictures} pictures  {one.alpha:.2f} "
            f"({one.alpha_interval[0]:.2f} to {one.alpha_interval[1]:.2f})",
            f"  one rater, ICC(3,1)  {one.one_rater:.2f} "
            f"({one.one_rater_interval[0]:.2f} to {one.one_rater_interval[1]:.2f})",
        ]
    for each in differences(answers, key):
        lines.append(
            f"{each.question}: {each.first} less {each.other}  {each.mean:+.2f} "
            f"({each.interval[0]:+.2f} to {each.interval[1]:+.2f}), p by rater {each.p_raters:.3g}, "
            f"by item {each.p_items:.3g}"
        )
    return lines


def _share(found: Proportion | None) -> str:
    if found is None:
        return "none decided"
    low, high = found.interval
    return f"{found.hits} of {found.of} ({found.share:.0%}; {low:.0%} to {high:.0%}), p {found.p:.2g}"
