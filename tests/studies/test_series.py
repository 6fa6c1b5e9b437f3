"""Seeds follow from the commit, and from nothing else."""

from studies.blind.elsewhere import COLUMNS
from studies.blind.series import SERIES, WITH_A_COLUMN, seed_of, wanted
from studies.blind.worlds import sketch_world


def test_seeds_differ_by_commit_series_and_index_and_are_reproducible() -> None:
    seeds = [seed_of(commit, s.name, k) for commit in ("abc", "abd") for s in SERIES for k in range(30)]
    assert len(set(seeds)) == len(seeds)
    assert seed_of("abc", "none", 3) == seed_of("abc", "none", 3)
    assert all(0 <= seed < 2**31 for seed in seeds)


def test_every_series_can_be_drawn() -> None:
    for series in SERIES:
        for cause in series.causes or (None,):
            sketch = sketch_world(series.stratum, 5, cause, q=series.q)
            assert sketch.stratum == series.stratum
            assert cause is None or sketch.causes == (cause,)
            assert series.q is None or set(sketch.q) == {series.q}


def test_a_share_of_the_table_has_a_world_of_each_series() -> None:
    assert [wanted(s, 1.0) for s in SERIES] == [s.worlds for s in SERIES]
    assert all(1 <= wanted(s, 0.01) <= wanted(s, 0.5) < s.worlds for s in SERIES)


def test_what_is_shuffled_has_a_column() -> None:
    assert set(WITH_A_COLUMN) == set(COLUMNS)
