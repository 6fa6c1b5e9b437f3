import re
from collections.abc import Callable
from dataclasses import replace

from pentimento.report import painting_words
from pentimento.report.inputs import PaintingInputs


def plain(html: str) -> str:
    return re.sub(r"<[^>]*>", "", html).replace("\N{NO-BREAK SPACE}", " ")


def test_the_summary_says_what_came_out(painting: PaintingInputs) -> None:
    text = plain(painting_words.summary(painting))
    assert "the round brush and 2 paints, the robot made 3 strokes. After every 2 strokes" in text
    assert "lowered the final error by 20 %" in text and "2.50 times smaller than that" in text


def test_the_words_follow_results_of_the_other_sign(worse: Callable[[], PaintingInputs]) -> None:
    text = plain(painting_words.summary(worse()))
    assert "raised the final error by 25 %" in text and "2.00 times larger than that" in text
    assert "2.00 times larger than the polyline" in plain(painting_words.sim2real(worse()))
    assert "25 % of that of a blank canvas" in plain(painting_words.sim2real(worse()))


def test_the_deviation_is_compared_as_it_ended(painting: PaintingInputs, worse: Callable[[], PaintingInputs]) -> None:
    same = replace(painting, deviation_with=painting.deviation_without)
    assert "ended farther from the first plan than the one without, at 0.0200" in painting_words.deviation(painting)
    assert "ended nearer to the first plan than" in painting_words.deviation(worse())
    assert "ended as near to the first plan as" in painting_words.deviation(same)


def test_equal_gaps_are_called_so(painting: PaintingInputs) -> None:
    assert "as large as the polyline" in plain(painting_words.sim2real(replace(painting, sim2real_factor=1.0)))


def test_the_target_is_called_the_photograph_only_where_it_is(painting: PaintingInputs) -> None:
    assert "tones that the tool’s own ink can reach" in painting_words.target(painting)
    assert "the photograph itself" in painting_words.target(replace(painting, target=painting.photograph))


def test_the_planning_loss_is_said_by_its_ends(painting: PaintingInputs) -> None:
    assert "from 0.200 to 0.0100 in 2 iterations" in painting_words.planning(painting)
