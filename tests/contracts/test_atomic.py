import errno
import os
from pathlib import Path

import pytest

from pentimento.contracts.atomic import atomic_folder, atomic_write


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def full_disk(*_: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_write_makes_parents_and_leaves_nothing_else(tmp_path: Path) -> None:
    atomic_write(tmp_path / "a" / "b.txt", b"one")
    atomic_write(tmp_path / "a" / "b.txt", b"two")
    assert (tmp_path / "a" / "b.txt").read_bytes() == b"two"
    assert names(tmp_path / "a") == ["b.txt"]


def test_a_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    atomic_write(tmp_path / "f", b"old")
    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="No space"):
        atomic_write(tmp_path / "f", b"new")
    assert (tmp_path / "f").read_bytes() == b"old"
    assert names(tmp_path) == ["f"]


def test_a_folder_appears_only_when_it_is_complete(tmp_path: Path) -> None:
    target = tmp_path / "data" / "out"
    with atomic_folder(target) as folder:
        (folder / "sub").mkdir()
        (folder / "sub" / "x").write_text("1")
        assert not target.exists()
    assert (target / "sub" / "x").read_text() == "1"
    assert names(target.parent) == ["out"]


def old_folder(tmp_path: Path) -> Path:
    with atomic_folder(tmp_path / "out") as folder:
        (folder / "x").write_text("old")
    return tmp_path / "out"


def test_a_new_folder_replaces_the_old_one_entirely(tmp_path: Path) -> None:
    target = old_folder(tmp_path)
    with atomic_folder(target) as folder:
        (folder / "y").write_text("new")
    assert names(target) == ["y"]
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_exception_leaves_the_old_folder(tmp_path: Path, error: type[BaseException]) -> None:
    target = old_folder(tmp_path)
    with pytest.raises(error), atomic_folder(target) as folder:
        (folder / "x").write_text("half")
        raise error
    assert (target / "x").read_text() == "old"
    assert names(tmp_path) == ["out"]


def test_a_full_disk_at_the_flush_leaves_the_old_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = old_folder(tmp_path)
    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="No space"), atomic_folder(target) as folder:
        (folder / "x").write_text("new")
    assert (target / "x").read_text() == "old"
    assert names(tmp_path) == ["out"]


def test_a_failing_rename_puts_the_old_folder_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target, rename = old_folder(tmp_path), Path.rename

    def failing(self: Path, other: Path) -> Path:
        if self.name.endswith(".tmp"):
            full_disk()
        return rename(self, other)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(OSError, match="No space"), atomic_folder(target) as folder:
        (folder / "x").write_text("new")
    assert (target / "x").read_text() == "old"
    assert names(tmp_path) == ["out"]


def test_crash_between_the_two_renames_is_repaired_by_the_next_call(tmp_path: Path) -> None:
    target = old_folder(tmp_path)
    target.rename(tmp_path / ".out.old")
    with pytest.raises(ValueError), atomic_folder(target):
        raise ValueError
    assert (target / "x").read_text() == "old"


def test_a_file_where_the_folder_belongs_is_replaced_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    for _ in range(2):
        with atomic_folder(tmp_path / "out") as folder:
            (folder / "part").write_text("new")
        assert [entry.name for entry in tmp_path.iterdir()] == ["out"]
