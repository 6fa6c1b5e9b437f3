import pytest

from pentimento.report.wording import comparison, count, decimal, lowered, percent, signed_mm, tool_name


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0042132, "0.00421"), (0.00001234, "0.0000123"), (12.345, "12.3"), (0.5, "0.500"), (0, "0"),
     (340, "340"), (1234.5, "1234"), (0.9996, "1.00"), (99.96, "100"), (-0.0251, "-0.0251")],
)  # fmt: skip
def test_decimals_have_three_significant_digits_and_no_exponent(value: float, text: str) -> None:
    assert decimal(value) == text


@pytest.mark.parametrize(
    ("share", "text"), [(0.234, "23\u00a0%"), (0.052, "5.2\u00a0%"), (1.0, "100\u00a0%"), (0.0, "0.0\u00a0%")]
)
def test_small_percentages_keep_a_decimal(share: float, text: str) -> None:
    assert percent(share) == text


@pytest.mark.parametrize(
    ("share", "verb"), [(0.2, "lowered the error by 20"), (-0.2, "raised the error by 20"), (1e-5, "did not change")]
)
def test_the_verb_follows_the_sign(share: float, verb: str) -> None:
    assert lowered("the error", share).startswith(verb)


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (3.1, "3.10 times smaller than"),
        (0.5, "2.00 times larger than"),
        (1.0, "as large as"),
        (0.0, "infinitely larger than"),
    ],
)
def test_factor_below_one_is_inverted(factor: float, text: str) -> None:
    assert comparison(factor, "smaller", "larger") == text


def test_lengths_have_a_minus_sign_and_zero_has_none() -> None:
    assert [signed_mm(x).replace("\N{NO-BREAK SPACE}", " ") for x in (3.1e-4, -2e-4, -1e-7)] == [
        "+0.31 mm", "\N{MINUS SIGN}0.20 mm", "0.00 mm"
    ]  # fmt: skip


def test_counts_and_names() -> None:
    assert (count(1, "paint"), count(12, "paint"), tool_name("round_brush")) == ("1 paint", "12 paints", "round brush")
