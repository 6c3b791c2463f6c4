"""Names that files give: what becomes of them in file systems and in terminals."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oed.cli.terminal.console import print_results
from oed.cli.terminal.messages import say, tell
from oed.foundation.errors import FileIssue, Issue, UserMistake
from oed.foundation.files import file_stem, inside, name_issue
from oed.foundation.shown import shown
from oed.records.stored.result import Result

ESCAPE = "\x1b[2J\x1b]0;gone\x07"
BIDI = "safe\u202etxt.exe"


class TestNamesOfFiles:
    def test_usual_names_serve(self):
        for name in ("ipopt", "my drive", "square_same_length", "Weg 2 (lang)", "é+1.b"):
            assert name_issue(name) == ""
            assert file_stem(name) == name.replace(" ", "_")

    def test_others_are_refused(self):
        names = [
            *("", " ", ".", "..", "../evil", "/etc/passwd", "a/b", "a\\b", "C:evil", "a\x00b", "a\nb"),
            *("-rf", ".hidden", "dot.", ESCAPE, BIDI, "x" * 181, "ä" * 91, "NUL", "com1.csv", "\u2024\u2024"),
            "\ud800",
        ]
        for name in names:
            assert name_issue(name).startswith("expected a name"), repr(name)
            assert shown(name_issue(name)) == name_issue(name)
            with pytest.raises(UserMistake, match="expected a name"):
                file_stem(name)

    @pytest.mark.slow
    @settings(max_examples=50)
    @given(st.text(max_size=30))
    def test_no_name_leads_out_of_its_folder(self, name: str):
        if name_issue(name) == "":
            folder = Path("/there")
            assert (folder / f"{file_stem(name)}_x.csv").parent == folder
            assert (folder / name).resolve().parent == folder

    def test_links_lead_out_of_no_folder(self, tmp_path: Path):
        (tmp_path / "own").mkdir()
        (tmp_path / "own" / "link").symlink_to(tmp_path)
        (tmp_path / "own" / "here").mkdir()
        assert inside(tmp_path / "own", "here") == tmp_path / "own" / "here"
        assert inside(tmp_path / "none yet", "here").name == "here"
        # A name may be longer than what is named after it.
        assert inside(tmp_path / "own", f"{'x' * 180}_commands.json").parent == tmp_path / "own"
        for name in ("link", "..", "../own/here", "x" * 256):
            with pytest.raises(UserMistake):
                inside(tmp_path / "own", name)


class TestTerminal:
    def test_what_steers_is_seen(self):
        assert shown(ESCAPE) == r"\x1b[2J\x1b]0;gone\x07"
        assert shown(BIDI) == r"safe\u202etxt.exe"
        assert shown("a\r\n\tb\x9b\u2028") == r"a\r\n\tb\x9b\u2028"
        assert shown("\ud800") == r"\ud800"

    def test_what_does_not_is_left(self):
        texts = ["wheel speed", "Ω λ_min ≤ 3 µm", "not\u00a0passed", "\\n", "日本"]
        assert [shown(text) for text in texts] == texts

    @given(st.text())
    def test_once_is_enough(self, text: str):
        assert shown(shown(text)) == shown(text)
        shown(text).encode()

    def test_issues(self):
        assert str(FileIssue(f"{ESCAPE}.csv", 3, 0, BIDI, "a\nb")).count("\\") == 5
        assert "\x1b" not in str(Issue((ESCAPE,), ESCAPE))

    def test_messages(self, capsys: pytest.CaptureFixture[str]):
        say(f"first\n{ESCAPE}")
        tell(BIDI)
        assert capsys.readouterr() == (f"{shown(BIDI)}\n", f"first\n{shown(ESCAPE)}\n")

    def test_tables(self, capsys: pytest.CaptureFixture[str]):
        numbers = ("objective", "smallest_singular_value", "condition_number", "norm_y", "path_length")
        entry = {
            "name": f"{ESCAPE}[/red]",
            **dict.fromkeys(numbers, 1.0),
            "feasible": False,
            "wall_seconds": 0.0,
            "status": "scored",
            "message": f"{BIDI}[/bold]",
            "violations": {f"[/x]{ESCAPE}": 1.0},
        }
        print_results([Result.model_construct(**entry)])
        written = capsys.readouterr().out
        assert written.count(shown(ESCAPE)) == 3
        assert f"{shown(BIDI)}[/bold]" in written
        assert "\x1b" not in written
        assert "\u202e" not in written
