"""Numbers in words; comparisons state the direction of the result."""

from __future__ import annotations

import math

_UNCHANGED = 0.0005  # a change of less than 0.05 % would be shown as 0.0 %


def decimal(value: float, digits: int = 3) -> str:
    """`value` with `digits` significant digits and no exponent: 0.00421, 12.3, 340."""
    if value == 0:
        return "0"
    rounded = float(f"{value:.{digits - 1}e}")
    return f"{value:.{max(digits - 1 - math.floor(math.log10(abs(rounded))), 0)}f}"


def percent(share: float) -> str:
    """0.234 -> 23 %, 0.052 -> 5.2 %, with a no-break space."""
    number = 100 * share
    return f"{number:.1f}\u00a0%" if abs(number) < 9.95 else f"{number:.0f}\u00a0%"


def signed_mm(length_m: float) -> str:
    """+0.31 mm, −0.20 mm, with a minus sign."""
    text = f"{1000 * length_m:+.2f}"
    return ("0.00" if float(text) == 0 else text.replace("-", "−")) + " mm"


def count(number: int, noun: str) -> str:
    """1 paint, 12 paints."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def lowered(what: str, share: float) -> str:
    """A verb phrase: lowered, raised (a negative fraction) or did not change `what`."""
    if abs(share) < _UNCHANGED:
        return f"did not change {what}"
    return f"{'lowered' if share > 0 else 'raised'} {what} by {percent(abs(share))}"


def comparison(factor: float, more: str, less: str) -> str:
    """3.1 -> 3.1 times {more} than; 0.5 -> 2.0 times {less} than; 1 -> as large as."""
    if abs(factor - 1) < _UNCHANGED:
        return "as large as"
    if factor > 1:
        return f"{decimal(factor)} times {more} than"
    return f"{decimal(1 / factor)} times {less} than" if factor > 0 else f"infinitely {less} than"


def tool_name(name: str) -> str:
    """round_brush -> round brush."""
    return name.replace("_", " ")
