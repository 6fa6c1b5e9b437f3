"""Windows of a request: relations as places, room on a begun canvas, and what stays as it is."""

import numpy as np
import pytest

from pentimento.control.layout import THING, WHOLE, Window, Wish, arranged, drawn_in_windows, wishes_for, with_room
from pentimento.control.request import Asked, understand
from pentimento.deploy.words import taught_vocabulary

NAMED = taught_vocabulary("named")
SIDE = 96


def arrangement(words: str) -> dict[str, list[Window]]:
    request = understand(words, NAMED)
    found: dict[str, list[Window]] = {}
    for wish in arranged(request.things, in_a_row=request.in_a_row):
        found.setdefault(wish.words, []).append(wish.window)
    return found


def blank() -> np.ndarray:
    return np.full((SIDE, SIDE, 3), 250, np.uint8)


def test_thing_alone_has_the_whole_canvas() -> None:
    assert arrangement("a cat") == {"a cat": [WHOLE]}


@pytest.mark.parametrize(
    ("words", "first", "second"),
    [
        ("a cat to the left of a dog", "a cat", "a dog"),
        ("a dog to the right of a cat", "a cat", "a dog"),
        ("a cat and a dog", "a cat", "a dog"),
    ],
)
def test_left_and_right(words: str, first: str, second: str) -> None:
    found = arrangement(words)
    assert found[first][0].x < found[second][0].x and found[first][0].y == found[second][0].y


@pytest.mark.parametrize(
    ("words", "upper", "lower"),
    [
        ("a sun above a house", "a sun", "a house"),
        ("a house under a sun", "a sun", "a house"),
        ("a house with a sun above it", "a sun", "a house"),
        ("a cat on a bed", "a cat", "a bed"),
        ("a sun above a house and a tree", "a sun", "a tree"),
    ],
)
def test_above_and_below(words: str, upper: str, lower: str) -> None:
    found = arrangement(words)
    assert found[upper][0].y + 0.2 < found[lower][0].y


def test_inside_is_a_small_window_in_the_middle_and_drawn_last() -> None:
    request = understand("two fish in a bathtub", NAMED)
    wishes = arranged(request.things, in_a_row=False)
    assert [wish.words for wish in wishes] == ["a bathtub", "a fish", "a fish"]
    assert wishes[0].window == WHOLE and all(wish.window.size < 0.5 for wish in wishes[1:])
    assert wishes[1].window.x < wishes[2].window.x


def test_behind_is_drawn_first_and_overlaps() -> None:
    behind, before = arranged(understand("a tree behind a house", NAMED).things, in_a_row=False)
    assert (behind.words, before.words) == ("a tree", "a house")
    apart = max(abs(behind.window.x - before.window.x), abs(behind.window.y - before.window.y))
    assert apart < THING * (behind.window.size + before.window.size) / 2


@pytest.mark.parametrize("words", ["four cats", "three cats in a row", "a cat, a dog and a fish", "a cat on two beds"])
def test_windows_lie_on_the_canvas_and_apart(words: str) -> None:
    windows = [window for several in arrangement(words).values() for window in several]
    for window in windows:
        half = window.size / 2 - 1e-9
        assert half <= min(window.x, window.y) and max(window.x, window.y) <= 1 - half
    for at, one in enumerate(windows):
        for other in windows[:at]:
            assert max(abs(one.x - other.x), abs(one.y - other.y)) >= THING * (one.size + other.size) / 2 - 0.05


def test_between_stands_in_the_middle() -> None:
    found = arrangement("a cat between a dog and a fish in a row")
    assert found["a dog"][0].x < found["a cat"][0].x < found["a fish"][0].x


@pytest.mark.parametrize(("side", "across"), [("left", 0), ("upper", 1), ("right", 0)])
def test_begun_canvas_leaves_the_room_that_is_free(side: str, across: int) -> None:
    canvas = blank()
    first, last = (SIDE // 2, SIDE) if side == "right" else (0, SIDE // 2)
    strip = [slice(None), slice(None)]
    strip[1 - across] = slice(first + 4, last - 4)
    canvas[tuple(strip)] = 20
    window = with_room([Wish("a cat", WHOLE)], canvas)[0].window
    middle = window.y if across else window.x
    assert (middle < 0.5) == (side == "right")
    assert 0.4 < THING * window.size < 0.6


def test_things_that_leave_room_for_more_fill_a_sheet_from_its_corners() -> None:
    canvas, windows = blank(), []
    for _ in range(4):
        window = with_room([Wish("a cat", WHOLE)], canvas, largest=0.45)[0].window
        windows.append(window)
        canvas[window.pixels(SIDE)] = 20
    assert all(window.size == pytest.approx(0.45) for window in windows)
    assert {(window.x < 0.5, window.y < 0.5) for window in windows} == {(a, b) for a in (0, 1) for b in (0, 1)}


def test_full_canvas_gets_the_thing_where_there_is_least_paint() -> None:
    canvas = np.full((SIDE, SIDE, 3), 250, np.uint8)
    canvas[::6], canvas[:, ::6] = 20, 20
    canvas[SIDE // 2 :, SIDE // 2 :][::3] = 20
    window = with_room([Wish("a cat", WHOLE)], canvas)[0].window
    assert 0.3 < window.size < 1 and (window.x < 0.5 or window.y < 0.5)


def test_request_of_a_planner_of_scenes_is_one_wish_with_the_medium() -> None:
    request = understand("a cat beside a dog", NAMED)
    whole = wishes_for(request, blank(), "in colours", by_window=False)
    assert whole == [Wish("a cat beside a dog, in colours", WHOLE)]
    apart = wishes_for(request, blank(), "in colours", by_window=True)
    assert [wish.words for wish in apart] == ["a cat, in colours", "a dog, in colours"]


def test_only_what_a_window_changes_is_changed() -> None:
    canvas = np.random.default_rng(0).integers(180, 251, (SIDE, SIDE, 3), dtype=np.uint8)
    seen = []

    def complete(small: np.ndarray, words: str, number: int) -> np.ndarray:
        seen.append((words, number, small.shape))
        drawn = small.copy()
        drawn[8:24, 8:24] = 0
        return drawn

    wishes = [Wish("a cat", Window(0.25, 0.25, 0.5)), Wish("a dog", Window(0.75, 0.75, 0.5))]
    goal = drawn_in_windows(canvas, wishes, side_px=32, has_ink=False, complete=complete)
    assert seen == [("a cat", 0, (32, 32, 3)), ("a dog", 1, (32, 32, 3))]
    changed = (goal != canvas).any(-1)
    assert changed[12:36, 12:36].all() and changed[60:84, 60:84].all()
    assert changed.sum() == 2 * 24 * 24 and (goal[14:34, 14:34] == 0).all()


def test_what_stands_on_the_canvas_is_not_erased() -> None:
    canvas = np.full((SIDE, SIDE, 3), 250, np.uint8)
    canvas[10:20, 10:40] = (40, 90, 200)

    def complete(small: np.ndarray, _words: str, _number: int) -> np.ndarray:
        completion = np.full_like(small, 250)  # it forgets what is there
        completion[30:34, 5:50] = 20
        completion[15:34, 30:34] = 20
        return completion

    goal = drawn_in_windows(canvas, [Wish("a line", WHOLE)], side_px=SIDE, has_ink=False, complete=complete)
    kept = (goal == canvas).all(-1)
    assert kept[10:15, 10:40].all() and kept[10:20, 10:30].all()
    assert (goal[30:34, 5:50] == 20).all() and (goal[15:34, 30:34] == 20).all()  # what is drawn may lie over it


def test_goal_planner_sees_white_paper_and_its_paper_becomes_that_of_the_canvas() -> None:
    cream = np.array([240, 235, 220], np.uint8)
    canvas = np.full((SIDE, SIDE, 3), cream)
    seen = []

    def complete(small: np.ndarray, words: str, number: int) -> np.ndarray:
        seen.append(small.copy())
        drawn = np.full_like(small, 249)  # it changes the paper a little everywhere
        drawn[8:24, 8:24] = (200, 40, 40)
        return drawn

    goal = drawn_in_windows(canvas, [Wish("a cat", WHOLE)], side_px=32, has_ink=False, complete=complete)
    assert (seen[0] == 250).all()
    assert np.abs(goal[0, 0].astype(int) - cream).max() <= 1
    assert np.abs(goal[48, 48] - np.array([200, 40, 40]) * cream / 250).max() <= 1


def test_lines_of_a_small_window_are_as_wide_as_those_of_the_whole_canvas() -> None:
    canvas = np.full((128, 128, 3), 250, np.uint8)
    canvas[:, 100] = 20  # a thin line that was there

    def complete(small: np.ndarray, words: str, number: int) -> np.ndarray:
        drawn = small.copy()
        drawn[30:33, 20:100] = 10
        return drawn

    widths = []
    for size in (1.0, 0.5, 0.35):
        wish = [Wish("a cat", Window(size / 2, size / 2, size))]
        goal = drawn_in_windows(canvas, wish, side_px=128, has_ink=True, complete=complete)
        middle = round(60 * size)
        widths.append(float((250.0 - goal[: round(60 * size), middle, 0]).sum() / 240))
        assert (goal[100:, 90:] == canvas[100:, 90:]).all()
    assert 2 <= min(widths) <= max(widths) <= 3  # not 1.5 and 1 in the smaller windows


def test_link_to_nothing_before_is_ignored() -> None:
    assert arranged([Asked("a cat", 1, None)], in_a_row=True) == [Wish("a cat", WHOLE)]
