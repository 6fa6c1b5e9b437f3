import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from pentimento.studio.clay.recovery import draw_peak, elastic_m, firm_m, rise_far, spring_back

CELL_M = 0.001
ROW, COLUMN = np.mgrid[:60, :60] - 29.5
DISTANCE = np.hypot(ROW, COLUMN)
PRE = np.full((60, 60), 0.04)
DENT = np.clip(0.005 * (1 - (DISTANCE / 8) ** 2), 0.0, None)
RIM = np.exp(-(((DISTANCE - 11) / 2) ** 2))


def test_shallow_dents_recover_a_share_and_deep_ones_a_limit() -> None:
    recovered = elastic_m(np.array([1e-6, 0.1]), limit_m=0.003, share=0.5, setting=0.0)
    assert_allclose(recovered, [0.5e-6, 0.003], rtol=1e-3)
    assert np.all(elastic_m(DENT, 0.003, 0.5, 0.4) <= elastic_m(DENT, 0.003, 0.5, 0.0))


def test_fresh_material_is_not_firm_and_worked_material_more_and_more() -> None:
    dent = np.array([0.004, 0.004, 0.004])
    firm = firm_m(dent, np.array([0.0, 1.0, 10.0]))
    assert firm[0] == 0.0 < firm[1] < firm[2] < 0.004


def test_springback_keeps_the_balance_of_dent_rim_far_places_and_pores() -> None:
    rim = RIM * 0.6 * DENT.sum() / RIM.sum()
    aside, lost = (share * DENT.sum() * CELL_M**2 for share in (0.1, 0.3))
    height, aside_after, lost_after = spring_back(
        PRE - DENT + rim, PRE, elastic_m(DENT, 0.003, 0.5, 0.1), aside_m3=aside, lost_m3=lost, cell_m=CELL_M
    )
    change = height - PRE
    assert_allclose(-change.sum() * CELL_M**2, aside_after + lost_after, rtol=1e-9)
    assert -0.9 * DENT.max() < change.min() < -0.3 * DENT.max()
    assert 0 < change.max() < rim.max()
    assert 0 < lost_after < lost


def test_nothing_elastic_changes_nothing() -> None:
    height, aside, lost = spring_back(PRE - DENT, PRE, np.zeros_like(PRE), aside_m3=1e-9, lost_m3=2e-9, cell_m=CELL_M)
    assert_array_equal(height, PRE - DENT)
    assert (aside, lost) == (1e-9, 2e-9)


def test_far_places_rise_by_one_volume_mostly_ahead() -> None:
    weights = rise_far((60, 60), np.array([29.5, 29.5]), np.array([1.0, 0.0]), 0.01, CELL_M)
    assert_allclose(weights.sum(), 1.0)
    assert weights[:, 30:].sum() > 0.55
    assert weights[29, 59] > 0.02 * weights.max()  # a long tail
    at_rest = rise_far((60, 60), np.array([29.5, 29.5]), np.zeros(2), 0.01, CELL_M)
    assert_allclose(at_rest, at_rest[:, ::-1])


def test_a_peak_rises_in_the_contact_out_of_its_collar() -> None:
    contact = DISTANCE < 6
    height = draw_peak(PRE, contact, 0.002, CELL_M)
    assert_allclose(height.sum(), PRE.sum())
    assert_allclose(height[29, 29] - 0.04, 0.002, rtol=0.3)
    assert height[29, 36] < 0.04
    assert_array_equal(draw_peak(PRE, contact, 0.0, CELL_M), PRE)
