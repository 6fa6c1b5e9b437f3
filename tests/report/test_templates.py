import pytest
from jinja2 import UndefinedError
from markupsafe import Markup

from pentimento.report import templates
from pentimento.report.templates import render


def rendered(source: str, **values: object) -> str:
    return templates._environment().from_string('{% import "macros.html" as html %}' + source).render(**values)


def test_strings_are_escaped_and_markup_is_not() -> None:
    assert rendered("{{ a }}{{ b }}", a="<b>", b=Markup("<i>")) == "&lt;b&gt;<i>"


def test_missing_variable_is_an_error() -> None:
    with pytest.raises(UndefinedError, match="absent"):
        rendered("{{ absent }}")


def test_base_page_has_the_style_sheet() -> None:
    page = render("base.html")
    assert page.startswith("<!doctype html>") and "@media (prefers-color-scheme: dark)" in page


def test_table_marks_number_columns_and_row_heads() -> None:
    page = rendered('{{ html.table(["model", "IoU"], [["poly<line", "0.6"]], "Scores") }}')
    assert '<th scope="col">model</th><th scope="col" class="number">IoU</th>' in page
    assert '<th scope="row">poly&lt;line</th><td class="number">0.6</td>' in page


@pytest.mark.parametrize(("share", "width"), [(0.5, "50.0%"), (1.7, "100.0%"), (-1.0, "0.0%")])
def test_bar_is_clipped_to_its_cell(share: float, width: str) -> None:
    assert width in rendered("{{ html.bar(share) }}", share=share)


def test_figure_embeds_the_picture_and_a_still_for_reduced_motion() -> None:
    page = rendered(
        '{{ html.figure("photo", "gif", data, alt, "Lapse.", still=b) }}', data=b"GIF", alt='a "b"', b=b"PNG"
    )
    assert 'alt="a &#34;b&#34;" src="data:image/gif;base64,R0lG"' in page
    assert 'media="(prefers-reduced-motion: reduce)" srcset="data:image/png;base64,' in page


def test_formatters_are_filters() -> None:
    assert rendered("{{ 0.234 | percent }}, {{ 2 | count('paint') }}") == "23\u00a0%, 2 paints"
