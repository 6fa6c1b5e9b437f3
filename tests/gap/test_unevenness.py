"""Tables of what is left of a mark's own shape."""

import numpy as np

from pentimento.gap.imprint import LEVELS, Imprint, imprint
from pentimento.gap.unevenness import estimate_unevenness, unevenness_of

SHAPE = (48, 64)


def strokes(count: int) -> tuple[Imprint, np.ndarray]:
    rng = np.random.default_rng(0)
    t = np.linspace(0, 1, 24)
    marks, press = [], []
    for _ in range(count):
        angle, depth = rng.uniform(0, 2 * np.pi), rng.uniform()
        column, row = 32 + 14 * np.cos(angle) * (2 * t - 1), 24 + 14 * np.sin(angle) * (2 * t - 1)
        marks.append(np.stack([column, row, 3 + depth + 0 * t, 1 + 0 * t, 0.8 + 0 * t], -1))
        press.append(np.full(24, depth))
    return imprint(np.stack(marks), np.eye(len(LEVELS))[0], SHAPE), np.stack(press)


def test_a_streak_beside_the_middle_is_found_and_drawn_again() -> None:
    made, press = strokes(160)
    streak = np.where(made.segment >= 0, 0.1 * np.exp(-(((made.place[..., 0] - 0.4) / 0.25) ** 2)), 0.0)
    table = estimate_unevenness(made, press, streak, (made.segment >= 0).astype(float))
    left = streak - unevenness_of(made, press, table)
    assert np.square(left).sum() < 0.1 * np.square(streak).sum()


def test_no_more_is_believed_than_strokes_agree_on() -> None:
    made, press = strokes(40)
    one = made._replace(**{name: getattr(made, name)[:1] for name in made._fields})
    few, many = (
        estimate_unevenness(m, p, np.full(m.coverage.shape, 0.1), (m.segment >= 0).astype(float))
        for m, p in ((one, press[:1]), (made, press))
    )
    assert 0 < few.body.max() < 0.5 * many.body.max() <= 0.05


def test_nothing_is_added_where_no_stroke_is() -> None:
    made, press = strokes(5)
    table = estimate_unevenness(made, press, np.ones(made.coverage.shape), np.ones(made.coverage.shape))
    assert not unevenness_of(made, press, table)[made.segment < 0].any()
