"""Files are written whole or not at all."""

from __future__ import annotations

import os
import socket
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from oed.foundation.errors import Failure, FileError, UserMistake
from oed.foundation.files import no_such_file, read_bytes, read_text, require_writable, text_of, write_text
from oed.foundation.work.folders import updated
from oed.report.film.writing import write_frames


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
def test_files_that_other_threads_make_meanwhile_are_none_of_its_business(tmp_path: Path, monkeypatch):
    # What new files may be is the process's: to ask for it is to change it.
    monkeypatch.setattr(os, "umask", lambda _: pytest.fail("changed for all threads"))
    write_text(tmp_path / "report.md", "text")
    (tmp_path / "other").touch()
    modes = {file.stat().st_mode for file in tmp_path.iterdir()}
    assert len(modes) == 1


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


@pytest.mark.skipif(os.name != "posix", reason="there are no such things elsewhere")
class TestReplacing:
    """A file takes the place of a file only."""

    @pytest.fixture(autouse=True)
    def here(self, tmp_path: Path, monkeypatch) -> Path:
        monkeypatch.chdir(tmp_path)
        return tmp_path

    @pytest.mark.parametrize("kind", ["pipe", "socket"])
    def test_what_is_no_file_stays(self, kind: str):
        with special_file(Path("a.gif"), kind) as path:
            before = os.lstat(path)
            for write in (
                lambda: write_text(path, "x"),
                lambda: write_frames(iter(()), path, 10.0),
                lambda: written_into(Path.cwd(), path.name),
            ):
                with pytest.raises(UserMistake, match=f"a.gif: cannot be written: a {kind} is there"):
                    write()
            assert os.path.samestat(os.lstat(path), before)
            assert names(Path()) == ["a.gif"]

    @pytest.mark.parametrize("to", ["b.txt", "nowhere", "pipe"])
    def test_links_stay(self, here: Path, to: str):
        (here / "b.txt").write_text("b")
        os.mkfifo("pipe")
        Path("a.gif").symlink_to(to)
        for write in (lambda: write_text(here / "a.gif", "x"), lambda: write_frames(iter(()), "a.gif", 10.0)):
            with pytest.raises(UserMistake, match="it is a link; name the file itself"):
                write()
        assert os.readlink("a.gif") == to
        assert names(here) == ["a.gif", "b.txt", "pipe"]


def written_into(folder: Path, name: str) -> None:
    with updated(folder) as draft:
        draft.write({name: "x"})
        draft.publish()


class TestReading:
    """What is no file is never waited for, and never read without end."""

    @pytest.fixture
    def place(self, tmp_path: Path) -> Path:
        return tmp_path / "a.txt"

    def test_text_has_one_kind_of_line_end(self, place: Path):
        place.write_bytes("\ufeffGröße\r\nx\ry\n".encode())
        assert read_text(place, "utf-8-sig") == "Größe\nx\ny\n"
        assert read_bytes(place).endswith(b"\r\nx\ry\n")

    def test_at_most_so_much(self, place: Path):
        place.write_bytes(b"x" * 1000)
        assert len(read_bytes(place, 1000)) == 1000
        with pytest.raises(OSError, match=r"expected at most 0\.000999 MB, got 0\.001 MB"):
            read_bytes(place, 999)

    @pytest.mark.skipif(not Path("/proc/self/maps").is_file(), reason="there is none elsewhere")
    def test_what_has_no_size_beforehand(self):
        assert len(read_text("/proc/self/maps").splitlines()) > 10
        with pytest.raises(OSError, match="expected at most 0"):
            read_bytes("/proc/self/maps", 100)

    def test_names_that_no_file_has(self):
        with pytest.raises(OSError, match="no file can have that name"):
            read_bytes("a\0b")

    def test_a_folder_and_nothing(self, place: Path):
        with pytest.raises(FileNotFoundError):
            read_bytes(place)
        with pytest.raises(IsADirectoryError):
            read_bytes(place.parent)

    @pytest.mark.skipif(os.name != "posix", reason="there are no such things elsewhere")
    @pytest.mark.parametrize("kind", ["pipe", "socket", "device"])
    @pytest.mark.parametrize("linked", [False, True])
    def test_what_is_no_file(self, place: Path, monkeypatch, kind: str, linked: bool):
        # The path of a socket has to be short.
        monkeypatch.chdir(place.parent)
        with special_file(Path(place.name), kind) as path:
            if linked:
                Path("link").symlink_to(path)
            with pytest.raises(OSError, match=f"expected a file, got a {kind}"):
                read_bytes("link" if linked else path)

    def test_what_takes_the_place_of_a_file(self, place: Path, monkeypatch):
        os.mkfifo(place)
        ordinary = place.with_name("b.txt")
        ordinary.write_text("x")
        real = os.stat(ordinary)
        monkeypatch.setattr(os, "stat", lambda *_, **__: real)
        with pytest.raises(OSError, match="expected a file, got a pipe"):
            read_bytes(place)


@contextmanager
def special_file(path: Path, kind: str) -> Iterator[Path]:
    """A pipe, a socket or a device at a path; for the last a link, as only the mighty make devices."""
    if kind == "device":
        path.symlink_to("/dev/zero")
    if kind == "pipe":
        os.mkfifo(path)
    with socket.socket(socket.AF_UNIX) as opened:
        if kind == "socket":
            opened.bind(str(path))
        yield path


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("drive_1.csv", "no such file; did you mean drive_2.csv?"),
        ("drive_2", "no such file; did you mean drive_2.csv?"),
        ("Drive_2.CSV", "no such file; did you mean drive_2.csv?"),
        ("elsewhere.csv", "no such file"),
        ("*.csv", "no such file, but 1 that match, as drive_2.csv: give it without quotes"),
        ("*.bag", "no such file"),
    ],
)
def test_a_file_that_is_not_there_is_said_with_the_nearest(tmp_path: Path, name: str, said: str):
    (tmp_path / "drive_2.csv").write_text("")
    with pytest.raises(FileError) as caught:
        text_of(tmp_path / name, FileError)
    assert str(caught.value) == f"{tmp_path / name}: {said}"


def test_a_folder_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(FileError, match=r"no such file, nor a folder .*logs$"):
        text_of(tmp_path / "logs" / "a.csv", FileError)


def test_a_link_to_a_missing_file_says_where_it_leads(tmp_path: Path):
    link = tmp_path / "dangling.csv"
    link.symlink_to("gone.csv")
    text = no_such_file(link)
    assert "gone.csv" in text
    assert "did you mean" not in text
