from base64 import b64decode

from pentimento.report.html import Album, bar, table


def test_a_picture_is_in_the_page_and_beside_it() -> None:
    album = Album()
    html = album.photo("cat.png", b"\x89PNG", 'a "cat"', "A <b>cat</b>.")
    assert album.files == {"cat.png": b"\x89PNG"}
    assert b64decode(html.partition("base64,")[2].partition('"')[0]) == b"\x89PNG"
    assert 'alt="a &quot;cat&quot;"' in html and "<figcaption>A <b>cat</b>.</figcaption>" in html


def test_an_animation_has_a_still_for_readers_without_motion() -> None:
    html = Album().photo("lapse.gif", b"GIF", "lapse", "", still=b"PNG")
    assert 'media="(prefers-reduced-motion: reduce)" srcset="data:image/png' in html
    assert 'src="data:image/gif' in html


def test_tables_head_their_columns_and_rows() -> None:
    html = table(("model", "IoU"), [("polyline", "0.6")], "Scores")
    assert '<th scope="col">model</th><th scope="col" class="number">IoU</th>' in html
    assert '<th scope="row">polyline</th><td class="number">0.6</td>' in html


def test_a_bar_stays_in_its_cell() -> None:
    assert "100.0%" in bar(1.7) and "0.0%" in bar(-1.0)
