"""Drawings of nouns: the vocabulary is unambiguous, and a drawing fills its square with lines inside the painting."""

import json
import tarfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from pentimento.contracts.errors import ConfigError
from pentimento.copainting.drawings import sources
from pentimento.copainting.drawings.sources import SIDE_PX, named_drawing, nouns_of, vocabulary


def test_vocabulary_has_many_nouns_and_half_of_them_have_two_sources() -> None:
    nouns = vocabulary().values()
    assert len(nouns) >= 200
    assert len(nouns_of("tabler")) >= len(nouns) / 2 - 1


def test_each_word_names_one_noun_and_each_drawing_shows_one() -> None:
    nouns = vocabulary().values()
    words = [word for noun in nouns for word in (noun.name, *noun.synonyms)]
    assert sorted(words) == sorted(set(words))
    for drawings in ([noun.openmoji for noun in nouns], [noun.tabler for noun in nouns if noun.tabler]):
        assert len(drawings) == len(set(drawings))


@pytest.mark.parametrize(("name", "source"), [("cat", "openmoji"), ("airplane", "openmoji"), ("house", "tabler")])
def test_drawing_fills_its_square_and_its_painting_covers_its_lines(name: str, source: sources.Source) -> None:
    drawing = named_drawing(name, source)
    visible = np.maximum(drawing.ink, drawing.painting[..., 3]) > 8
    extents = [np.ptp(np.flatnonzero(visible.any(axis))) + 1 for axis in (0, 1)]
    assert abs(max(extents) - SIDE_PX) <= 6
    ends = [(np.flatnonzero(visible.any(axis))[[0, -1]].sum() - (SIDE_PX - 1)) / 2 for axis in (0, 1)]
    assert np.abs(ends).max() <= 2  # centred
    inked = drawing.ink > 200
    assert inked.any() and (drawing.painting[inked, 3] > 150).mean() > 0.95
    assert (drawing.painting[..., :3].max(-1) <= drawing.painting[..., 3]).all()  # multiplied by alpha


def test_openmoji_pen_drawing_has_no_fill() -> None:
    apple = named_drawing("apple", "openmoji")
    assert (apple.ink > 127).mean() < 0.25 < (apple.painting[..., 3] > 127).mean()


def test_missing_package_is_named_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sources._PACKAGES, "openmoji", ("no-such-package", "svg"))
    with pytest.raises(ConfigError, match=r"no-such-package .* not installed"):
        named_drawing.__wrapped__("cat", "openmoji")


SQUARE = {"body": '<path fill="#00f" d="M2 4h8v4h-8z"/>'}


def write_archive(folder: Path, source: sources.Source, names: list[str], codes: dict[str, str] | None) -> None:
    icons = {"icons": dict.fromkeys(names, SQUARE), "width": 12, "height": 12}
    contents = {"icons": icons} | ({} if codes is None else {"chars": codes})
    package, _, version = sources.ARCHIVES[source].rpartition("@")
    file = folder / f"{package[1:].replace('/', '-')}-{version}.tgz"
    with tarfile.open(file, "w:gz") as archive:
        for name, content in contents.items():
            data = json.dumps(content).encode()
            member = tarfile.TarInfo(f"package/{name}.json")
            member.size = len(data)
            archive.addfile(member, BytesIO(data))


def test_drawing_is_read_from_an_archive(tmp_path: Path) -> None:
    write_archive(tmp_path, "noto", ["cat"], {"1f408": "cat"})
    drawing = named_drawing("cat", "noto", tmp_path)
    assert not drawing.ink.any()
    covered = drawing.painting[..., 3] > 127
    assert abs(covered.mean() - 0.5) < 0.02  # twice as wide as high
    assert (drawing.painting[covered] == (0, 0, 255, 255)).all(-1).mean() > 0.97
    with pytest.raises(ConfigError, match=r"twemoji is not in .*make base"):
        named_drawing("cat", "twemoji", tmp_path)


def test_archive_without_code_points_has_the_names_of_another_one_or_is_asked_by_words(tmp_path: Path) -> None:
    write_archive(tmp_path, "noto", ["cat", "dog"], {"1f408": "cat", "1f415": "dog"})
    write_archive(tmp_path, "emojione", ["dog"], None)
    assert sources.nouns_of("emojione", tmp_path) == ("dog",)
    write_archive(tmp_path, "phosphor", ["palm-tree-light", "pizza", "mouse-light", "sofa-light"], None)
    # `pizza` lacks the ending of light lines, `couch` is found by its synonym, and the mouse is a computer's.
    assert sources.nouns_of("phosphor", tmp_path) == ("couch", "palm tree")
