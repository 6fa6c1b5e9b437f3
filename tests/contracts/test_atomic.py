import errno
import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from pentimento.contracts.atomic import RECORD, add_to_record, atomic_folder, atomic_write, command_folder, command_page
from pentimento.contracts.errors import ConfigError


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


def write(path: Path, text: str, command: str = "pentimento import") -> None:
    with command_folder(path, command) as folder:
        (folder / "part").mkdir()
        (folder / "part/table").write_text(text)
        (folder / "README.md").write_text("# Table")


def test_a_command_replaces_its_own_folder_and_an_empty_one(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    write(tmp_path / "out", "first")
    write(tmp_path / "out", "second")
    assert (tmp_path / "out/part/table").read_text() == "second"
    assert names(tmp_path / "out") == [RECORD, "README.md", "part"] and names(tmp_path) == ["out"]


@pytest.mark.parametrize(
    ("harm", "named"),
    [
        (
            lambda folder: (folder / "notes.txt").write_text("mine"),
            r"notes.txt, which `pentimento import` did not write",
        ),
        (lambda folder: (folder / "part/.hidden").write_text("mine"), r"part/\.hidden, which"),
        (lambda folder: (folder / "README.md").write_text("license: mine"), "README.md, which was changed since"),
        (lambda folder: (folder / "photos").mkdir(), "photos, which"),
        (lambda folder: (folder / "link").symlink_to(folder / "part"), "link, which"),
        (lambda folder: (folder / RECORD).unlink(), "README.md, which"),
        (lambda folder: (folder / RECORD).write_text("[]"), "README.md, which"),
    ],
)
def test_a_command_refuses_to_delete_what_it_did_not_write(
    tmp_path: Path, harm: Callable[[Path], object], named: str
) -> None:
    write(tmp_path / "out", "first")
    harm(tmp_path / "out")
    with pytest.raises(ConfigError, match=named):
        write(tmp_path / "out", "second")
    assert (tmp_path / "out/part/table").read_text() == "first"


def test_a_file_that_was_recorded_later_is_replaced_until_somebody_changes_it(tmp_path: Path) -> None:
    write(tmp_path / "out", "first")
    for text in ("card", "another card"):
        (tmp_path / "out/CARD.md").write_text(text)
        add_to_record(tmp_path / "out", "CARD.md")
    write(tmp_path / "out", "second")
    assert names(tmp_path / "out") == [RECORD, "README.md", "part"]
    (tmp_path / "out/CARD.md").write_text("card")
    add_to_record(tmp_path / "out", "CARD.md")
    (tmp_path / "out/CARD.md").write_text("mine")
    with pytest.raises(ConfigError, match=r"CARD.md, which was changed since"):
        write(tmp_path / "out", "third")
    (tmp_path / "none").mkdir()
    (tmp_path / "none/CARD.md").write_text("card")
    add_to_record(tmp_path / "none", "CARD.md")
    assert names(tmp_path / "none") == ["CARD.md"]


def test_a_command_refuses_the_folder_of_another_one_a_file_and_a_link(tmp_path: Path) -> None:
    write(tmp_path / "out", "first")
    with pytest.raises(ConfigError, match=r"README.md, which `pentimento export` did not write"):
        write(tmp_path / "out", "second", "pentimento export")
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ConfigError, match="is a file, which would be deleted"):
        write(tmp_path / "file", "second")
    (tmp_path / "link").symlink_to(tmp_path / "out")
    with pytest.raises(ConfigError, match="is a link"):
        write(tmp_path / "link", "second")
    assert (tmp_path / "out/part/table").read_text() == "first" and (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("place", [".", "..", "", "../work", "/", "sub/.."])
def test_a_command_refuses_the_folder_in_which_it_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    (tmp_path / "work/sub").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "work")
    with pytest.raises(ConfigError, match="holds the folder in which you are"):
        write(Path(place), "text")
    assert names(tmp_path / "work") == ["sub"]


def test_a_share_that_cannot_flush_folders_is_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """CIFS, shared folders of virtual machines and some FUSE file systems answer EINVAL."""
    flush = os.fsync

    def of_a_share(handle: int) -> None:
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            raise OSError(errno.EINVAL, "Invalid argument")
        flush(handle)

    monkeypatch.setattr(os, "fsync", of_a_share)
    atomic_write(tmp_path / "file", b"new")
    with atomic_folder(tmp_path / "folder") as folder:
        (folder / "part").write_bytes(b"new")
    assert (tmp_path / "file").read_bytes() == (tmp_path / "folder/part").read_bytes() == b"new"


def test_a_command_replaces_its_own_unchanged_page_only(tmp_path: Path) -> None:
    page, command = tmp_path / "page.html", "pentimento replay"
    command_page(page, "old", command)
    command_page(page, "new", command)
    assert page.read_bytes().startswith(b"new\n<!--")
    for other in (b"<p>mine</p>", page.read_bytes().replace(b"new", b"mine"), b"", page.read_bytes() + b"more"):
        page.write_bytes(other)
        with pytest.raises(ConfigError, match="was not written by `pentimento replay`"):
            command_page(page, "new", command)
        assert page.read_bytes() == other
    page.unlink()
    command_page(page, "theirs", "pentimento card")
    with pytest.raises(ConfigError, match="name a new file"):
        command_page(page, "new", command)
