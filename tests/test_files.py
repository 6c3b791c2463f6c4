"""Files are written whole or not at all."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from oed.errors import Failure, UserMistake
from oed.files import require_writable, write_text


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_text_is_written_as_it_is(tmp_path: Path):
    write_text(tmp_path / "a.txt", "Größe\r\nx\n")
    assert (tmp_path / "a.txt").read_bytes() == "Größe\r\nx\n".encode()
    assert names(tmp_path) == ["a.txt"]


def test_folders_are_made(tmp_path: Path):
    write_text(tmp_path / "a" / "b" / "c.txt", "x")
    assert (tmp_path / "a" / "b" / "c.txt").read_text() == "x"


def test_an_old_file_is_replaced(tmp_path: Path):
    for text in ("long long text", "short"):
        write_text(tmp_path / "a.txt", text)
    assert (tmp_path / "a.txt").read_text() == "short"
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.skipif(os.name != "posix", reason="permissions are POSIX's")
def test_others_may_read_it_as_any_other_file(tmp_path: Path):
    ordinary = tmp_path / "ordinary.txt"
    ordinary.write_text("x")
    write_text(tmp_path / "a.txt", "x")
    modes = {stat.S_IMODE(path.stat().st_mode) for path in (ordinary, tmp_path / "a.txt")}
    assert len(modes) == 1


@pytest.mark.parametrize("old", [None, "old"])
class TestFailing:
    """Nothing is left behind, and what was there stays."""

    @pytest.fixture
    def folder(self, tmp_path: Path, old: str | None) -> Path:
        if old is not None:
            (tmp_path / "a.txt").write_text(old)
        return tmp_path

    def assert_untouched(self, folder: Path, old: str | None) -> None:
        assert names(folder) == ([] if old is None else ["a.txt"])
        if old is not None:
            assert (folder / "a.txt").read_text() == old

    def test_while_writing(self, folder: Path, old: str | None):
        with pytest.raises(UnicodeEncodeError):
            write_text(folder / "a.txt", "a good beginning \ud800")
        self.assert_untouched(folder, old)

    @pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()], ids=["error", "interrupt"])
    def test_while_renaming(self, folder: Path, old: str | None, monkeypatch, error: BaseException):
        def fail(*_: object) -> None:
            raise error

        monkeypatch.setattr(os, "replace", fail)
        with pytest.raises((type(error), UserMistake)):
            write_text(folder / "a.txt", "new")
        monkeypatch.undo()
        self.assert_untouched(folder, old)


def test_a_full_disk_is_no_mistake_of_the_users(tmp_path: Path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(Failure, match=r"a\.txt: cannot be written: No space left on device"):
        write_text(tmp_path / "a.txt", "new")
    assert names(tmp_path) == []


def test_a_name_as_long_as_names_can_be(tmp_path: Path):
    write_text(tmp_path / ("a" * 255), "x")
    assert names(tmp_path) == ["a" * 255]
    with pytest.raises(UserMistake, match="File name too long"):
        write_text(tmp_path / ("a" * 256), "x")
    assert names(tmp_path) == ["a" * 255]


def test_a_file_where_the_folder_should_be_is_the_users_mistake(tmp_path: Path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(UserMistake, match="file: cannot write there"):
        write_text(tmp_path / "file" / "a.txt", "x")


def test_a_folder_where_the_file_should_be_is_the_users_mistake(tmp_path: Path):
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(UserMistake):
        write_text(tmp_path / "a.txt", "x")
    assert names(tmp_path) == ["a.txt"]


def test_asking_whether_a_folder_can_be_written_to_leaves_none(tmp_path: Path):
    require_writable(tmp_path / "new")
    assert names(tmp_path) == []
    require_writable(tmp_path / "deep" / "new")
    assert names(tmp_path) == []
    require_writable(tmp_path)
    assert tmp_path.is_dir()
