"""Folders are replaced whole or not at all, whatever ends the process that writes them."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from oed.foundation.errors import UserMistake
from oed.foundation.work.folders import drafted, in_order, interrupted_runs, updated

OLD = {"record.json": "old", "gone.csv": "old", "figures/a.svg": "old", "mine/notes.txt": "mine"}
NEW = {"record.json": "new", "figures/b.svg": "new"}
AFTER = {**NEW, "mine/notes.txt": "mine"}
DROP = ("gone.csv", "figures/a.svg")


def contents(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()
    }


def fill(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def old(tmp_path: Path) -> Path:
    return fill(tmp_path / "out", OLD)


def hidden(folder: Path) -> list[str]:
    return [path.name for path in folder.rglob(".*")]


class TestPublishing:
    def test_a_new_folder(self, tmp_path: Path):
        with drafted(tmp_path / "deep" / "out") as draft:
            draft.write(NEW)
            assert not (tmp_path / "deep" / "out").exists()
            assert draft.publish() == tmp_path / "deep" / "out"
        assert contents(tmp_path) == {f"deep/out/{name}": text for name, text in NEW.items()}

    def test_an_old_one_is_swapped_and_what_is_the_users_stays(self, old: Path):
        (old / "empty").mkdir()
        (old / "link").symlink_to("mine")
        note = os.stat(old / "mine" / "notes.txt")
        with drafted(old) as draft:
            draft.write(NEW)
            assert contents(old) == OLD
            draft.publish(DROP)
        assert contents(old) == AFTER
        assert (old / "empty").is_dir()
        assert (old / "link").is_symlink()
        # The same file, not a copy: whoever has it open goes on with it.
        assert os.path.samestat(os.stat(old / "mine" / "notes.txt"), note)
        assert hidden(old.parent) == []

    def test_where_there_are_no_hard_links_it_is_copied(self, old: Path, monkeypatch: pytest.MonkeyPatch):
        def fail(*_: object, **__: object) -> None:
            raise OSError

        monkeypatch.setattr(os, "link", fail)
        with drafted(old) as draft:
            draft.write(NEW)
            draft.publish(DROP)
        assert contents(old) == AFTER

    def test_the_working_folder_stays_the_same_one(self, old: Path, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.chdir(old / "mine")
        before = os.stat(old)
        with drafted("..") as draft:
            draft.write(NEW)
            draft.publish(DROP)
        assert contents(old) == AFTER
        assert os.path.samestat(os.stat(old), before)
        assert Path("notes.txt").exists()
        assert hidden(old.parent) == []

    def test_a_mounted_folder_has_its_draft_inside(self, old: Path, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr(os.path, "ismount", lambda path: Path(path) == old)
        with drafted(old) as draft:
            assert draft.path.is_relative_to(old)
            draft.write(NEW)
            draft.publish(DROP)
        assert contents(old) == AFTER
        assert hidden(old.parent) == []

    def test_a_link_to_a_folder_stays_one(self, old: Path):
        link = old.parent / "link"
        link.symlink_to(old.name)
        with drafted(link) as draft:
            draft.write(NEW)
            draft.publish(DROP)
        assert link.is_symlink()
        assert contents(old) == AFTER

    def test_nothing_carried(self, old: Path):
        with drafted(old) as draft:
            draft.write(NEW)
            draft.publish(carry=False)
        assert contents(old) == NEW

    def test_single_files_go_in_one_by_one(self, old: Path):
        before = os.stat(old)
        with updated(old) as draft:
            draft.write(NEW)
            assert contents(old) == OLD
            draft.publish(DROP)
        assert contents(old) == AFTER
        assert os.path.samestat(os.stat(old), before)
        assert hidden(old.parent) == []


class TestLeftEarly:
    @pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, UserMistake])
    def test_the_old_folder_is_untouched_and_the_new_one_kept_beside(self, old: Path, error: type[Exception]):
        def work() -> None:
            with drafted(old) as draft:
                draft.write(NEW)
                raise error

        with pytest.raises(error) as caught:
            work()
        assert contents(old) == OLD
        beside = old.with_name("out.interrupted")
        assert contents(beside) == NEW
        (note,) = caught.value.__notes__
        assert f"kept in {beside}: `oed report {beside}`" in note
        assert hidden(old.parent) == []
        # A second one does not take the first one's place.
        with pytest.raises(error):
            work()
        assert interrupted_runs(old) == [beside, old.with_name("out.interrupted-2")]

    def test_nothing_written_is_nothing_kept(self, tmp_path: Path):
        with pytest.raises(KeyboardInterrupt), drafted(tmp_path / "a" / "out"):
            raise KeyboardInterrupt
        assert list(tmp_path.iterdir()) == []

    def test_of_what_can_be_made_again_nothing_is_kept(self, old: Path):
        def work() -> None:
            with updated(old) as draft:
                draft.write(NEW)
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            work()
        assert contents(old) == OLD
        assert [path.name for path in old.parent.iterdir()] == ["out"]


class Killed(BaseException):
    """Stands for a process that ends at once: nothing of its own runs any more."""


def killed_at(step: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the given call on that would change files, every one fails."""
    calls = 0

    def dying(real: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object, **options: object) -> object:
            nonlocal calls
            calls += 1
            if calls > step:
                raise Killed
            return real(*arguments, **options)

        return call

    for module, name in ((os, "link"), (os, "replace"), (shutil, "rmtree"), (Path, "unlink")):
        monkeypatch.setattr(module, name, dying(getattr(module, name)))


@pytest.mark.parametrize("place", ["beside", "working", "mounted"])
@pytest.mark.slow
def test_killed_at_any_moment_of_the_swap_there_is_the_old_or_the_new(
    tmp_path: Path, place: str, monkeypatch: pytest.MonkeyPatch
):
    """Whatever moment it was, the next one that looks there finds one or the other, and no mix."""
    real_ismount, found = os.path.ismount, set[str]()
    for step in range(30):
        old = fill(tmp_path / str(step) / "out", OLD)
        with monkeypatch.context() as patch:
            if place == "working":
                patch.chdir(old)
            if place == "mounted":
                patch.setattr(
                    os.path, "ismount", lambda path, own=old: Path(path) == own or real_ismount(path)
                )
            with patch.context() as dying:
                try:
                    with drafted(old) as draft:
                        draft.write(NEW)
                        killed_at(step, dying)
                        draft.publish(DROP)
                    survived = True
                except Killed:
                    survived = False
            kept = interrupted_runs(old)
            now = {name: text for name, text in contents(old).items() if ".interrupted" not in name}
            if now == OLD:
                (beside,) = kept
                assert contents(beside).items() >= NEW.items()
                found.add("old")
            else:
                # A file that has no meaning any more may be left where a folder has to stay.
                assert {**now, **AFTER} == now
                assert set(now) - set(AFTER) <= (set() if place == "beside" else set(DROP))
                assert kept == []
                found.add("new")
            assert hidden(old.parent) == []
        if survived:
            break
    assert survived
    assert found == {"old", "new"}


class TestLinks:
    """Folders come from elsewhere too, with links that lead to what is the user's own."""

    @pytest.fixture
    def elsewhere(self, tmp_path: Path) -> Path:
        return fill(tmp_path / "elsewhere", {"a.svg": "own", "old/own.txt": "own", "x": "own"})

    @pytest.mark.parametrize("making", [drafted, updated])
    def test_nothing_is_written_through_them(self, old: Path, elsewhere: Path, making: Callable[..., Any]):
        shutil.rmtree(old / "figures")
        (old / "figures").symlink_to(elsewhere)
        with (
            making(old) as draft,
            pytest.raises(UserMistake, match=r"out/figures: a link that leads out of the folder"),
        ):
            draft.write(NEW)
        with making(old) as draft:
            draft.write({"record.json": "new"})
            draft.publish(DROP)
        assert (old / "figures").is_symlink()
        assert contents(elsewhere) == {"a.svg": "own", "old/own.txt": "own", "x": "own"}

    def test_one_that_is_a_file_is_replaced_itself(self, old: Path, elsewhere: Path):
        (old / "record.json").unlink()
        (old / "record.json").symlink_to(elsewhere / "x")
        for making in (updated, drafted):
            with making(old) as draft:
                draft.write(NEW)
                draft.publish(DROP)
        assert contents(old) == AFTER
        assert (elsewhere / "x").read_text() == "own"

    @pytest.mark.parametrize("name", ["../x", "/x", "a/../../x", ".x", "a\nb"])
    def test_no_name_leads_out(self, old: Path, name: str):
        with drafted(old) as draft, pytest.raises(UserMistake):
            draft.write({name: "new"})

    @pytest.mark.parametrize("kind", ["oed", "pages"])
    @pytest.mark.parametrize("link", ["", "holder", "draft", "old", "ready"])
    def test_no_draft_is_put_in_order_through_them(self, old: Path, elsewhere: Path, kind: str, link: str):
        planted = old.with_name(f".out.{kind}") / link
        planted.parent.mkdir(exist_ok=True)
        planted.symlink_to(elsewhere / ("x" if link == "holder" else ""))
        making = drafted if kind == "oed" else updated
        with pytest.raises(UserMistake, match="a link where"), making(old):
            pass
        assert in_order(old.with_name("none")) == old.with_name("none")
        assert contents(elsewhere) == {"a.svg": "own", "old/own.txt": "own", "x": "own"}
        assert contents(old) == OLD

    def test_what_was_about_to_be_moved_is_not_moved_through_them(self, old: Path, elsewhere: Path):
        fill(old.with_name(".out.pages") / "ready", NEW)
        shutil.rmtree(old / "figures")
        (old / "figures").symlink_to(elsewhere)
        with pytest.raises(UserMistake, match="figures: a link that leads out of the folder"), updated(old):
            pass
        assert contents(elsewhere) == {"a.svg": "own", "old/own.txt": "own", "x": "own"}


class TestLock:
    def test_one_at_a_time_and_who_it_is(self, old: Path):
        with drafted(old) as draft:
            draft.write(NEW)
            text = rf"out: process {os.getpid()} on .* \(since .*\) is writing there; wait for it"
            with pytest.raises(UserMistake, match=text), drafted(old):
                pass
            # Readers leave it alone.
            assert interrupted_runs(old) == []
            draft.publish(DROP)
        assert contents(old) == AFTER
        with drafted(old):
            pass

    def test_another_folder_is_free(self, old: Path):
        with drafted(old), drafted(old.with_name("other")):
            pass

    @pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="nothing ends a process so suddenly")
    @pytest.mark.slow
    def test_a_killed_process_leaves_no_lock_and_its_run_is_kept(self, old: Path, caplog):
        program = (
            "import sys, os, signal; from oed.foundation.work.folders import drafted\n"
            "with drafted(sys.argv[1]) as draft:\n"
            "    draft.write({'record.json': 'begun'})\n"
            "    os.kill(os.getpid(), signal.SIGKILL)\n"
        )
        done = subprocess.run([sys.executable, "-c", program, str(old)], check=False)
        assert done.returncode == -signal.SIGKILL
        assert contents(old) == OLD
        with drafted(old):
            pass
        beside = old.with_name("out.interrupted")
        assert contents(beside) == {"record.json": "begun"}
        assert contents(old) == OLD
        (line,) = caplog.messages
        assert line.startswith(f"a run into {old} was killed; what had been done by then is kept in {beside}")
        assert hidden(old.parent) == []


class TestRefused:
    def test_a_file(self, tmp_path: Path):
        (tmp_path / "file").write_text("x")
        for place in (tmp_path / "file", tmp_path / "file" / "deeper"):
            with pytest.raises(UserMistake, match="cannot write there"), drafted(place):
                pass

    @pytest.mark.skipif(os.name != "posix", reason="no such device")
    def test_a_device_by_its_name(self):
        with pytest.raises(UserMistake, match="cannot write there: it is a device"), drafted("/dev/null"):
            pass

    def test_a_long_name(self, tmp_path: Path):
        with pytest.raises(UserMistake, match="a name of 400 bytes"), drafted(tmp_path / ("ä" * 200)):
            pass
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="nothing is forbidden to root")
    @pytest.mark.parametrize("place", ["out", "out/new"])
    def test_a_folder_that_may_only_be_read(self, old: Path, place: str):
        old.chmod(0o555)
        try:
            with (
                pytest.raises(UserMistake, match="cannot write there: Permission"),
                drafted(old.parent / place),
            ):
                pass
        finally:
            old.chmod(0o755)

    def test_a_folder_that_cannot_be_written_to(self, old: Path, monkeypatch: pytest.MonkeyPatch):
        def refuse(*_: object, **__: object) -> None:
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr("tempfile.TemporaryFile", refuse)
        with pytest.raises(UserMistake, match="out: cannot write there: Permission denied"), drafted(old):
            pass
        assert contents(old) == OLD


def test_a_signal_waits_until_the_folder_is_swapped(
    old: Path, interruptible, monkeypatch: pytest.MonkeyPatch
):
    real, struck = os.replace, []

    def replace(*arguments: object) -> None:
        signal.raise_signal(signal.SIGINT)
        struck.append(True)
        real(*arguments)

    def work() -> None:
        with drafted(old) as draft:
            draft.write(NEW)
            monkeypatch.setattr(os, "replace", replace)
            draft.publish(DROP)

    with pytest.raises(KeyboardInterrupt):
        work()
    assert len(struck) == 2
    assert contents(old) == AFTER
    assert interrupted_runs(old) == []
