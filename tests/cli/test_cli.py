"""The command line: every command, its exit code, and JSON alone on standard output."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import REPORTS
from recorded import keep_results
from studies import GENETIC, INFEASIBLE, SMALL, small, write_study

from oed.cli import main
from oed.cli.terminal.console import percent
from oed.foundation.errors import Issue, ProblemError
from oed.records.record import load_record

ONE = "{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}"
TEXT = small(solvers=ONE, baselines="[random]").replace("samples: 40", "samples: 12")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a valid study and a path."""
    monkeypatch.chdir(tmp_path)
    write_study(tmp_path, TEXT)
    write_study(tmp_path, small(solvers=GENETIC), "quick.yaml")
    rows = "".join(f"{0.25 * k},{0.05 * (k % 9)},{0.02 * (k % 13)}\n" for k in range(40))
    (tmp_path / "path.csv").write_text(f"t,wheel_speed_right,wheel_speed_left\n{rows}")
    return tmp_path


def call(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, standard output, standard error."""
    capsys.readouterr()
    try:
        code = main(arguments)
    except SystemExit as leaving:
        code = leaving.code
    captured = capsys.readouterr()
    assert "Traceback" not in captured.out + captured.err
    return code, captured.out, captured.err


def refuse(constant: str) -> None:
    raise AssertionError(f"{constant} is not JSON")


def call_json(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any], str]:
    """Exit code, the one JSON object on standard output, standard error."""
    code, out, err = call(capsys, *arguments, "--json")
    data = json.loads(out, parse_constant=refuse)
    assert isinstance(data, dict)
    return code, data, err


class TestHelp:
    def test_version(self, capsys):
        assert call(capsys, "--version") == (0, f"oed {version('oed')}\n", "")

    def test_no_arguments(self, capsys):
        code, out, _ = call(capsys)
        assert code == 2
        assert "usage: oed" in out
        for command in ("run", "check", "solve", "evaluate", "report", "schema"):
            assert f"\n    {command} " in out

    @pytest.mark.parametrize("command", ["run", "check", "solve", "evaluate", "report", "schema"])
    def test_every_command_explains_itself(self, capsys, command: str):
        code, out, _ = call(capsys, command, "--help")
        assert code == 0
        assert "--json" in out

    @pytest.mark.parametrize(
        "arguments",
        [
            ["fly"],
            ["run"],
            ["evaluate", "study.yaml"],
            ["run", "study.yaml", "--workers", "0"],
            ["solve", "study.yaml", "--seed", "-1"],
            ["solve", "study.yaml", "--seed", "one"],
            ["check", "study.yaml", "--seed", "1"],
        ],
        ids=" ".join,
    )
    def test_wrong_arguments(self, capsys, arguments: list[str]):
        code, out, err = call(capsys, *arguments)
        assert (code, out) == (2, "")
        assert "usage: oed" in err

    @pytest.mark.slow
    def test_help_imports_nothing_heavy(self):
        program = (
            "import sys\n"
            "from oed.cli import main\n"
            "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
            "print(sorted({'casadi', 'numpy', 'pydantic', 'pymoo', 'matplotlib', 'scipy', 'rich', 'yaml'}"
            " & set(sys.modules)), file=sys.stderr)"
        )
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        assert "usage: oed" in done.stdout
        assert done.stderr == "[]\n"

    @pytest.mark.slow
    def test_as_a_module(self):
        done = subprocess.run(
            [sys.executable, "-m", "oed", "--version"], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stdout) == (0, f"oed {version('oed')}\n")


class TestCheck:
    def test_a_valid_study(self, capsys, folder: Path):
        assert call(capsys, "check", "study.yaml") == (0, "study.yaml: ok (Small study)\n", "")

    def test_what_auto_means_is_said(self, capsys, folder: Path):
        write_study(
            folder,
            SMALL.replace("coefficients: 8", "coefficients: auto") + f"solvers: [{ONE}]\n",
            "auto.yaml",
        )
        code, out, _ = call(capsys, "check", "auto.yaml")
        assert (code, "16 coefficients, then 29, 55 as long as" in out) == (0, True)
        _, data, _ = call_json(capsys, "check", "auto.yaml")
        assert data["studies"][0]["refinement"].startswith("16 coefficients")

    def test_as_json(self, capsys, folder: Path):
        code, data, err = call_json(capsys, "check", "study.yaml", "quick.yaml")
        assert (code, err) == (0, "")
        assert [(entry["file"], entry["ok"]) for entry in data["studies"]] == [
            ("study.yaml", True),
            ("quick.yaml", True),
        ]

    @pytest.mark.slow
    def test_wrong_studies_among_right_ones(self, capsys, folder: Path):
        write_study(folder, TEXT.replace("18 cm", "18 kg"), "wrong.yaml")
        code, out, err = call(capsys, "check", "wrong.yaml", "study.yaml", "nowhere.yaml")
        assert code == 2
        assert out == "study.yaml: ok (Small study)\n"
        first, second = err.splitlines()
        assert first.startswith("wrong.yaml:3: robot.track: expected a length [m], got '18 kg'")
        assert second == "nowhere.yaml: no such file"

    def test_their_issues_as_json(self, capsys, folder: Path):
        write_study(folder, TEXT.replace("18 cm", "18 kg").replace("samples: 12", "samples: 0"), "wrong.yaml")
        code, data, _ = call_json(capsys, "check", "study.yaml", "wrong.yaml")
        assert code == 2
        right, wrong = data["studies"]
        assert (right["ok"], right["flaws"], wrong["ok"]) == (True, [], False)
        assert [(issue["line"], issue["key"]) for issue in wrong["flaws"]] == [
            (3, "robot.track"),
            (4, "trajectory.samples"),
        ]
        assert set(wrong["flaws"][0]) == {"file", "line", "column", "key", "message"}


class TestSolve:
    @pytest.mark.slow
    def test_a_table_and_nothing_written(self, capsys, folder: Path):
        before = sorted(folder.rglob("*"))
        code, out, _ = call(capsys, "solve", "study.yaml", "--quiet", "--workers", "1")
        assert code == 0
        assert "standard error" in out
        assert "objective" not in out
        assert max(map(len, out.splitlines())) <= 80
        assert sorted(folder.rglob("*")) == before

    @pytest.mark.slow
    def test_the_numbers_behind_the_answer_for_those_who_ask(self, capsys, folder: Path):
        code, out, _ = call(capsys, "solve", "study.yaml", "--quiet", "--workers", "1", "--verbose")
        assert code == 0
        assert "objective" in out
        assert "ipopt: Converged" in out

    @pytest.mark.slow
    def test_as_json(self, capsys, folder: Path):
        code, data, err = call_json(capsys, "solve", "quick.yaml", "--workers", "1")
        assert code == 0
        assert [result["name"] for result in data["results"]] == ["genetic"]
        assert data["results"][0]["feasible"]
        assert data["results"][0]["trajectory"] is None
        # Progress is told, but not on standard output.
        assert "genetic" in err

    def test_quiet(self, capsys, folder: Path):
        _, _, err = call_json(capsys, "solve", "quick.yaml", "--quiet", "--workers", "1")
        assert err == ""

    @pytest.mark.slow
    def test_seed(self, capsys, folder: Path):
        results = []
        for seed in ("0", "1", "1"):
            _, data, _ = call_json(capsys, "solve", "quick.yaml", "--quiet", "--workers", "1", "--seed", seed)
            assert data["seed"] == data["results"][0]["seed"] == int(seed)
            results.append(data["results"][0]["drive"])
        assert results[0] != results[1] == results[2]

    def test_out(self, capsys, folder: Path):
        arguments = ("solve", "quick.yaml", "--quiet", "--workers", "1", "--out", "there")
        code, data, _ = call_json(capsys, *arguments)
        assert code == 0
        assert {path.name for path in (folder / "there").iterdir()} == {"record.json", "genetic.csv"}
        assert load_record(folder / "there").data["results"] == data["results"]

    @pytest.mark.slow
    def test_a_study_without_a_solution(self, capsys, folder: Path):
        # By a search that takes no time; the limits that Ipopt names are seen in a run.
        text = INFEASIBLE.replace("{kind: ipopt, starts: 1, perturbations: 0}", GENETIC)
        write_study(folder, text, "infeasible.yaml")
        code, data, _ = call_json(capsys, "solve", "infeasible.yaml", "--quiet", "--workers", "1")
        assert code == 1
        (result,) = data["results"]
        assert (result["feasible"], result["objective"]) == (False, None)

    def test_interrupted(self, capsys, folder: Path, monkeypatch: pytest.MonkeyPatch):
        def strike(*_: object, **__: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("oed.workflow.runner.search", strike)
        code, data, err = call_json(capsys, "solve", "study.yaml", "--quiet")
        assert code == 1
        assert "interrupted" in data["error"]
        assert "interrupted" in err


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[int, str, str, Path]:
    """Exit code and output of `oed run` in a fresh folder, and the folder."""
    folder = tmp_path_factory.mktemp("cli")
    write_study(folder, TEXT, "my study.yaml")
    # Figures are drawn, with warnings as errors, in tests of reports: here it would take half of the time.
    program = (
        "from oed.cli import main; import sys; from oed.report import page; page._svg = lambda _: '<svg/>'; "
        "sys.exit(main(sys.argv[1:]))"
    )
    command = [
        sys.executable,
        "-W",
        "error",
        "-c",
        program,
        "run",
        "my study.yaml",
        "--workers",
        "1",
        "--json",
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr, folder


@pytest.mark.slow
class TestRun:
    def test_one_json_object(self, ran):
        code, out, err, _ = ran
        data = json.loads(out, parse_constant=refuse)
        assert code == 0
        assert [result["name"] for result in data["results"]][:2] == ["ipopt", "random"]
        assert data["directory"] == str(Path("reports") / "my study")
        assert "Traceback" not in err
        assert "Warning" not in err

    def test_record_and_report_are_in_the_default_folder(self, ran):
        *_, folder = ran
        out = folder / "reports" / "my study"
        assert {"record.json", "report.html", "report.md", "ipopt.csv", "random.csv"} <= {
            path.name for path in out.iterdir()
        }
        assert sorted(path.name for path in folder.iterdir()) == ["my study.yaml", "reports"]

    @pytest.mark.usefixtures("blank_figures")
    def test_the_report_is_made_again(self, ran, capsys, monkeypatch):
        # What is in them is shown where figures are drawn.
        monkeypatch.setattr("oed.report.figures.draw.picture_bytes", lambda _, form: form.encode())
        *_, folder = ran
        out = folder / "reports" / "my study"
        (out / "report.html").unlink()
        code, data, _ = call_json(capsys, "report", str(out), "--figures", "pdf")
        assert code == 0
        assert Path(data["report"]).exists()
        assert (out / "report.html").exists()
        figures = {path.name for path in (out / "figures").iterdir()}
        assert {"paths.svg", "paths.pdf"} <= figures
        assert (out / "figures" / "paths.pdf").read_bytes() == b"pdf"
        assert {Path(name).stem for name in figures if name.endswith("svg")} == {
            Path(name).stem for name in figures if name.endswith("pdf")
        }
        code, _, err = call(capsys, "report", str(out), "--figures", "gif")
        assert code == 2
        assert "pdf" in err

    @pytest.mark.usefixtures("blank_figures")
    def test_several_are_compared(self, ran, capsys, folder: Path):
        *_, other = ran
        first = str(other / "reports" / "my study")
        shutil.copytree(first, folder / "copy")
        code, data, _ = call_json(capsys, "report", first, "copy", "--out", "both")
        assert code == 0
        assert Path(data["report"]).parent == Path("both")
        assert (folder / "both" / "report.html").exists()

    def test_the_same_run_twice_is_no_comparison(self, ran, capsys, folder: Path):
        *_, other = ran
        first = other / "reports" / "my study"
        (folder / "link").symlink_to(first)
        for again in (str(first), "link", str(first / "record.json")):
            code, _, err = call(capsys, "report", str(first), again, "--out", "both")
            assert (code, err) == (2, f"{first} and {again} are the same run: give each once\n")
        assert not (folder / "both").exists()

    @pytest.mark.usefixtures("blank_figures")
    def test_in_words_into_another_folder(self, capsys, folder: Path):
        code, out, _ = call(capsys, "run", "quick.yaml", "--quiet", "--workers", "1", "--out", "put there")
        assert code == 0
        assert re.search(r"(^Warning: [\d.]+ %|None|[\d.]+ %) of 1,000\s+robots with wheel\s+radii", out)
        assert "Limits satisfied." not in out
        assert "Page:  put there" in out
        exports = [shlex.join(["oed", "export", "put there", "--to", to]) for to in ("ros2_node", "rosbag2")]
        assert f"Drive: {exports[0]}\n   or: {exports[1]}\n" in out
        assert not (folder / "reports").exists()
        assert load_record(folder / "put there").best.name == "genetic"

    def test_an_interrupt_while_the_report_is_written(self, capsys, folder: Path, monkeypatch):
        def strike(*_: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("oed.report.write_report", strike)
        code, out, err = call(capsys, "run", "quick.yaml", "--out", "put there", "--workers", "1", "--quiet")
        assert (code, out) == (1, "")
        assert err == "interrupted; the record is saved: `oed report 'put there'` makes the report\n"
        assert (folder / "put there" / "record.json").is_file()

    @pytest.mark.usefixtures("blank_figures")
    def test_without_a_solution(self, capsys, folder: Path):
        write_study(folder, INFEASIBLE.replace("3 rad/s", "8 rad/s"), "infeasible.yaml")
        code, out, _ = call(capsys, "run", "infeasible.yaml", "--quiet", "--workers", "1")
        assert code == 1
        assert "wheel speed" in out
        assert "workspace" in out
        lines = out.splitlines()
        assert lines[1] == "No drive was found that satisfies every limit."
        assert len(lines) <= 16
        assert max(map(len, lines)) <= 80
        assert "s_min" not in out
        assert "_" not in out.partition("Page:")[0]
        record = load_record(folder / "reports" / "infeasible")
        assert record.best is None
        (result,) = record.results
        assert (result.status, result.feasible, result.objective) == ("infeasible", False, None)
        assert "wheel speed" in result.message
        assert "workspace" in result.message


class TestRefusedAtTheStart:
    """What would be lost at the end is refused before any work is done."""

    @pytest.fixture(autouse=True)
    def idle(self, monkeypatch: pytest.MonkeyPatch):
        def work(*_: object, **__: object) -> None:
            pytest.fail("work has begun")

        monkeypatch.setattr("oed.workflow.runner.solve", work)
        monkeypatch.setattr("oed.workflow.experiments.validate", work)
        monkeypatch.setattr("oed.workflow.estimate_logs.calibrate", work)

    @pytest.mark.parametrize(
        "command",
        [
            ["run", "quick.yaml"],
            ["solve", "quick.yaml"],
            ["sweep", "quick.yaml", "--over", "seed=1"],
            ["estimate", "quick.yaml", "path.csv"],
        ],
        ids=lambda command: command[0],
    )
    @pytest.mark.slow
    def test_a_place_that_cannot_be_written_to(self, capsys, folder: Path, command: list[str]):
        before = sorted(folder.rglob("*"))
        for out in ("path.csv", "path.csv/deeper", "x" * 250):
            code, _, err = call(capsys, *command, "--out", out)
            assert code == 2, out
            assert err.startswith(f"{out}: cannot write there: ")
            assert len(err.splitlines()) == 1
            assert sorted(folder.rglob("*")) == before

    @pytest.mark.slow
    def test_a_name_that_is_too_long(self, capsys, folder: Path):
        write_study(folder, small(solvers=f"{GENETIC[:-1]}, name: {'x' * 260}}}"), "long.yaml")
        for command in ("check", "run"):
            code, _, err = call(capsys, command, "long.yaml")
            assert code == 2
            assert "solvers.0.name: expected a name of at most 180 bytes, got 260" in err


class TestEvaluate:
    @pytest.mark.slow
    def test_a_path(self, capsys, folder: Path):
        code, out, err = call(capsys, "evaluate", "study.yaml", "path.csv")
        assert (code, err) == (0, "")
        lines = out.splitlines()
        assert lines[0] == "path: 10 s of motion"
        assert lines[1].split() == ["value", "standard", "error"]
        assert [line.split()[0] for line in lines[2:-1]] == ["c21", "c22"]
        assert lines[-1] == "None of 1,000 robots with wheel radii ±2 %, track ±4 % leave the workspace."
        code, out, _ = call(capsys, "evaluate", "study.yaml", "path.csv", "--verbose")
        assert out.splitlines()[: len(lines)] == lines
        assert "objective" in out.splitlines()[len(lines)]

    @pytest.mark.slow
    def test_as_json(self, capsys, folder: Path):
        code, data, _ = call_json(capsys, "evaluate", "study.yaml", "path.csv")
        assert code == 0
        assert (data["name"], data["kind"], data["status"]) == ("path", "path", "scored")
        assert data["departures"]["results"][0]["share"] == 0
        assert data["trajectory"] == "path.csv"
        assert data["objective"] > 0
        assert data["feasible"]

    @pytest.mark.slow
    def test_limits_exceeded_are_named(self, capsys, folder: Path):
        text = (folder / "path.csv").read_text()
        (folder / "path.csv").write_text(text.replace("\n1.25,0.25,", "\n1.25,12,"))
        code, out, _ = call(capsys, "evaluate", "study.yaml", "path.csv")
        assert code == 0
        assert "exceeds wheel speed by 2.00 rad/s" in out

    @pytest.mark.slow
    def test_a_reserve_for_other_robots_is_told(self, capsys, folder: Path):
        text = (folder / "study.yaml").read_text()
        robust = "uncertainty: {x: 2 cm}\nrobust: {kind: chance, draws: 400}\n"
        (folder / "robust.yaml").write_text(text.replace("[-1 m, 1 m]", "[-3 cm, 3 cm]") + robust)
        _, out, _ = call(capsys, "evaluate", "robust.yaml", "path.csv")
        assert "of 400 simulated robots violate the limits" in out
        assert re.search(r"exceeds workspace by [\d.]+ m?m \(back-off for other robots included\)", out)
        assert "wheel speed by" not in out

    @pytest.mark.slow
    def test_a_drive_written_by_solve_scores_the_same(self, capsys, folder: Path):
        _, solved, _ = call_json(capsys, "solve", "quick.yaml", "--quiet", "--workers", "1", "--out", "there")
        _, scored, _ = call_json(capsys, "evaluate", "quick.yaml", "there/genetic.csv")
        assert scored["objective"] == pytest.approx(solved["results"][0]["objective"], rel=1e-9)
        assert scored["feasible"]


class TestSchema:
    @pytest.mark.parametrize("arguments", [[], ["--json"]])
    @pytest.mark.slow
    def test_one_object(self, capsys, arguments: list[str]):
        code, out, err = call(capsys, "schema", *arguments)
        assert (code, err) == (0, "")
        assert json.loads(out)["title"] == "oed study"


MISTAKES = {
    "unknown key": (
        ["solve", "wrong.yaml"],
        TEXT.replace("criterion:", "criterium:"),
        "wrong.yaml:10: criterium: unknown key; did you mean criterion?",
    ),
    "wrong unit": (["run", "wrong.yaml"], TEXT.replace("18 cm", "18 kg"), "wrong.yaml:3: robot.track: "),
    "syntax": (["check", "wrong.yaml"], TEXT.replace("limits:", "limits: ["), "wrong.yaml:8: not valid YAML"),
    "bad path": (
        ["evaluate", "study.yaml", "wrong.yaml"],
        "t,wheel_speed_right,wheel_speed_left\n0,1,1\n1,fast,1\n",
        "wrong.yaml:3: wheel_speed_right: expected a finite number, got 'fast'",
    ),
    "bad record": (["report", "wrong.yaml"], '{\n"format": one}', "wrong.yaml:2: cannot be read: not JSON"),
}


class TestMistakes:
    """One clear message on standard error with file and line, exit code 2, no traceback."""

    @pytest.mark.parametrize(("command", "text", "message"), MISTAKES.values(), ids=MISTAKES.keys())
    @pytest.mark.slow
    def test_in_words(self, capsys, folder: Path, command: list[str], text: str, message: str):
        write_study(folder, text, "wrong.yaml")
        code, out, err = call(capsys, *command)
        assert (code, out) == (2, "")
        assert err.startswith(message)
        assert len(err.splitlines()) == 1

    @pytest.mark.slow
    @pytest.mark.parametrize(("command", "text", "message"), MISTAKES.values(), ids=MISTAKES.keys())
    def test_as_json(self, capsys, folder: Path, command: list[str], text: str, message: str):
        write_study(folder, text, "wrong.yaml")
        code, data, err = call_json(capsys, *command)
        assert code == 2
        assert err.startswith(message)
        (issue,) = data["flaws"] if "flaws" in data else data["studies"][0]["flaws"]
        assert issue["file"] == "wrong.yaml"
        assert issue["line"] == int(message.split(":")[1])
        if "error" in data:
            assert data["error"].startswith(message)

    def test_three_at_once(self, capsys, folder: Path):
        text = (
            SMALL.replace("18 cm", "18 kg").replace("samples: 40", "samples: x").replace("kind: E", "kind: Q")
        )
        write_study(folder, text, "wrong.yaml")
        code, _, err = call(capsys, "solve", "wrong.yaml")
        assert code == 2
        assert [line.split(":")[1] for line in err.splitlines()] == ["3", "4", "10"]

    @pytest.mark.parametrize(
        "command",
        [["run", "nowhere.yaml"], ["report", "nowhere"], ["evaluate", "study.yaml", "nowhere.csv"]],
        ids=lambda command: command[0],
    )
    def test_no_such_file(self, capsys, folder: Path, command: list[str]):
        code, data, err = call_json(capsys, *command)
        assert code == 2
        assert command[-1] in err
        assert command[-1] in data["error"]

    @pytest.mark.parametrize("command", [["report"], ["validate"], ["next", "a.csv"]])
    def test_a_study_for_its_results(self, capsys, folder: Path, command: list[str]):
        name, *further = command
        code, _, err = call(capsys, name, "study.yaml", *further)
        assert code == 2
        assert "got a study: `oed run study.yaml` makes one; give the folder that it writes" in err

    @pytest.mark.parametrize("command", [["run"], ["evaluate", "a.csv"], ["plan", "--to", "track 1 mm"]])
    def test_a_folder_for_a_study(self, capsys, folder: Path, command: list[str]):
        name, *further = command
        code, _, err = call(capsys, name, ".", *further)
        assert code == 2
        assert "expected a file, got a folder; studies in it: " in err
        assert "study.yaml" in err

    @pytest.mark.parametrize("designs", [True, False])
    def test_an_estimate_for_a_design(self, capsys, folder: Path, designs: bool):
        keys = {"trajectory": {"duration": 1.0}} if designs else {}
        data = {"format": 1, "parameters": [], "study": keys}
        (folder / "estimate.json").write_text(json.dumps(data))
        code, _, err = call(capsys, "next", ".", "a.csv")
        assert code == 2
        assert "there is an estimate alone: `oed run` the study that it was made with" in err
        assert ("once `trajectory` and `limits` in it say" in err) == (not designs)

    def test_a_folder_that_cannot_be_written_to(self, capsys, folder: Path):
        arguments = ("solve", "quick.yaml", "--quiet", "--workers", "1", "--out", "path.csv")
        code, data, _ = call_json(capsys, *arguments)
        assert code == 2
        assert "cannot write there" in data["error"]


class TestValidate:
    """`oed validate DIR` simulates the drives of a saved record."""

    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        saved = REPORTS / "choi_skid_steer" / "record.json"
        data = json.loads(saved.read_text())
        # A search, a path like any other and one that tells nothing.
        keep_results(data, "ipopt", "straight", "square")
        folder = tmp_path / "saved"
        folder.mkdir()
        (folder / "record.json").write_text(json.dumps(data))
        return folder

    @pytest.mark.slow
    @pytest.mark.usefixtures("blank_figures")
    def test_the_record_and_report_are_updated(self, folder: Path, capsys: pytest.CaptureFixture[str]):
        assert (
            main(["validate", str(folder), "--heading", "predicted", "--replicates", "500", "--quiet"]) == 0
        )
        outcome = json.loads((folder / "record.json").read_text())["validation"]
        assert (outcome["heading"], outcome["replicates"]) == ("predicted", 500)
        names = [entry["name"] for entry in outcome["results"]]
        assert names == ["ipopt", "straight", "square"]
        printed = capsys.readouterr().out
        assert f"ipopt, ols: {outcome['results'][0]['verdict']}" in printed
        assert outcome["results"][0]["verdict"] in (folder / "report.md").read_text()

    @pytest.mark.slow
    def test_the_same_as_the_run_found(self, folder: Path, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("oed.report.write_report", lambda *_: folder / "report.html")
        before = json.loads((folder / "record.json").read_text())["validation"]
        assert main(["validate", str(folder), "--quiet"]) == 0
        after = json.loads((folder / "record.json").read_text())["validation"]
        # To rounding, which may differ between machines.
        for found, kept in zip(after["results"], before["results"], strict=True):
            for key in ("mean", "sampled_covariance", "promised_covariance"):
                np.testing.assert_allclose(found[key], kept[key], rtol=1e-9)

    @pytest.mark.slow
    def test_an_interrupt_leaves_everything_as_it_was(self, folder: Path, monkeypatch, capsys):
        def strike(*_: object, **__: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("oed.workflow.experiments.validate", strike)
        (folder / "report.html").write_text("old")

        def files() -> dict[Path, bytes]:
            # Of the folder, and of what is hidden beside it.
            places = folder.parent.glob(f"*{folder.name}*")
            found = (path for place in places for path in place.rglob("*"))
            return {path: path.read_bytes() for path in found if path.is_file()}

        before = files()
        assert main(["validate", str(folder), "--quiet"]) == 1
        assert capsys.readouterr().err == "interrupted\n"
        assert files() == before

    @pytest.mark.parametrize(
        ("options", "said"),
        [
            (
                ["--estimator", "nonlinear"],
                "validation.estimators: displacements are estimated by ols, sandwich, gls, "
                "errors_in_variables; not by nonlinear",
            ),
            (
                ["--estimator", "ols", "--estimator", "errors_in_variables"],
                "validation.heading: errors in variables are those of heading: measured; these are known",
            ),
        ],
    )
    def test_what_does_not_suit_the_measurement(self, folder: Path, capsys, options: list[str], said: str):
        before = (folder / "record.json").read_bytes()
        assert main(["validate", str(folder), *options, "--quiet"]) == 2
        assert said in capsys.readouterr().err
        assert (folder / "record.json").read_bytes() == before

    def test_too_few_replicates(self, folder: Path, capsys: pytest.CaptureFixture[str]):
        assert main(["validate", str(folder), "--replicates", "5", "--quiet"]) == 2
        assert "replicates" in capsys.readouterr().err


class TestExport:
    @pytest.mark.slow
    def test_writes_the_drive(self, folder, capsys):
        call(capsys, "solve", "quick.yaml", "--out", "made", "--quiet")
        code, data, _ = call_json(capsys, "export", "made", "--to", "csv")
        assert code == 0
        assert Path(data["export"]).read_text().startswith("t,wheel_speed_right,wheel_speed_left,v,omega")

    @pytest.mark.slow
    def test_names_the_formats_there_are(self, folder, capsys):
        call(capsys, "solve", "quick.yaml", "--out", "made", "--quiet")
        code, _, err = call(capsys, "export", "made", "--to", "dxf")
        assert code == 2
        assert "csv, json, rosbag2, ros2_node, ros2_yaml" in err


def test_shares_in_percent():
    shares = {0.0531: "5.3 %", 0.996: "100 %", 1.2: "120 %", 2e-5: "0.002 %", 0.31: "31 %"}
    assert {share: percent(share) for share in shares} == shares


def test_an_interrupt_in_the_middle_of_a_compiled_call(capsys, monkeypatch):
    def interrupted():
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    monkeypatch.setattr("oed.study.study.json_schema", interrupted)
    assert call(capsys, "schema") == (1, "", "interrupted\n")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            ZeroDivisionError("two\nlines"),
            "a defect of oed, not of your files (ZeroDivisionError: two lines);",
        ),
        (
            SystemError("of no interrupt"),
            "a defect of oed, not of your files (SystemError: of no interrupt);",
        ),
        (SystemExit(0), "something ended the program halfway (SystemExit: 0), which a robot's own module"),
        (RecursionError(), "a defect of oed, not of your files (RecursionError:);"),
    ],
)
def test_what_nobody_has_foreseen(capsys, monkeypatch: pytest.MonkeyPatch, error: BaseException, words: str):
    def fail():
        raise error

    monkeypatch.delenv("OED_DEBUG", raising=False)
    monkeypatch.setattr("oed.study.study.json_schema", fail)
    code, out, err = call(capsys, "schema")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert err.startswith(words)
    assert "OED_DEBUG=1" in err
    code, data, _ = call_json(capsys, "schema")
    assert code == 1
    assert data == {"error": err.strip(), "flaws": []}
    monkeypatch.setenv("OED_DEBUG", "1")
    with pytest.raises(type(error)):
        main(["schema"])


def test_a_working_directory_that_has_been_deleted(capsys, folder: Path, monkeypatch: pytest.MonkeyPatch):
    (folder / "gone").mkdir()
    monkeypatch.chdir(folder / "gone")
    (folder / "gone").rmdir()
    code, out, err = call(capsys, "run", str(folder / "study.yaml"), "--quiet")
    assert (code, out) == (1, "")
    assert err.startswith("the working directory has been deleted: change to another folder (")


def test_what_is_found_late_is_told_by_its_line(capsys, folder: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: Any, **__: Any) -> None:
        raise ProblemError([Issue(("limits", "wheel_speed"), "is too late"), Issue(("robot",), "as well")])

    monkeypatch.setattr("oed.study.study.Study.require_identifiable", refuse)
    code, data, err = call_json(capsys, "run", "study.yaml", "--quiet")
    assert code == 2
    assert err.splitlines() == [
        "study.yaml:7: limits.wheel_speed: is too late",
        "study.yaml:3: robot: as well",
    ]
    assert [issue["line"] for issue in data["flaws"]] == [7, 3]


WITH_NULL = [
    ["check", "a\0b"],
    ["estimate", "study.yaml", "a\0b"],
    ["evaluate", "study.yaml", "a\0b"],
    ["next", "a\0b", "log.csv"],
    ["report", "a\0b"],
    ["run", "study.yaml", "--out", "a\0b"],
    ["init", "a\0b", "--robot", "jackal"],
]


def test_null_characters_are_in_no_name(capsys):
    said = "no name of a file has the character '\\x00', got 'a\\x00b'\n"
    for arguments in WITH_NULL:
        assert call(capsys, *arguments) == (2, "", said), arguments


def test_what_is_no_part_of_a_log_to_hold_out(capsys):
    for given in ("0", "0%", "100%", "1.5", "-5%", "25 s", "a quarter", "nan"):
        code, _, err = call(capsys, "estimate", "study.yaml", "log.csv", f"--hold-out={given}")
        assert code == 2, given
        assert "--hold-out: " in err, given


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["check"], "oed check: the following arguments are required: STUDY; usage: oed check [-h]"),
        (["estimate", "study.yaml"], "oed estimate: the following arguments are required: LOG"),
        (["solve", "--workers", "0", "study.yaml"], "argument --workers: expected"),
        (["solve", "--wrong", "study.yaml"], "oed: unrecognized arguments: --wrong"),
        (["solev", "study.yaml"], "invalid choice: 'solev'"),
        ([], "oed: unrecognized arguments: --json"),
    ],
)
def test_mistakes_on_the_command_line_itself_as_json(capsys, arguments: list[str], words: str):
    for option in ("--json", "--jso"):
        code, out, err = call(capsys, *arguments, option)
        data = json.loads(out)
        assert (code, data["flaws"]) == (2, [])
        assert words.replace("--json", option) in data["error"], data
        assert data["error"] in err


@pytest.mark.parametrize("arguments", [["check"], ["check", "--", "--json"], ["check", "--wrong", "--", "a"]])
def test_mistakes_on_the_command_line_without_json(capsys, folder: Path, arguments: list[str]):
    code, out, err = call(capsys, *arguments)
    assert (code, out) == (2, "")
    assert "usage" in err or "no such file" in err


COUNTS = [
    (["solve", "study.yaml", "--workers", "0"], "expected a whole number of at least 1, got '0'"),
    (["bound", "study.yaml", "--nodes", "-1"], "expected a whole number of at least 1, got '-1'"),
    (["solve", "study.yaml", "--seed", "-1"], "expected a whole number of at least 0, got '-1'"),
    (["solve", "study.yaml", "--seed", "1.5"], "expected a whole number of at least 0, got '1.5'"),
    (["solve", "study.yaml", "--seed", "9" * 101], "expected a whole number of at most 100 digits, got"),
    (["solve", "study.yaml", "--seed", "9" * 5000], "expected a whole number of at most 100 digits, got"),
]


def test_counts_are_refused_in_the_words_of_python(capsys):
    for arguments, words in COUNTS:
        code, _, err = call(capsys, *arguments)
        assert code == 2, arguments
        assert words in err, err


@pytest.mark.slow
def test_a_seed_of_many_digits_is_taken_by_all(capsys, folder: Path):
    seed = "123456789012345678901234567890123456789012345678"
    drives = []
    write_study(folder, small(solvers=GENETIC, seed=seed), "seeded.yaml")
    for given in (["quick.yaml", "--seed", seed], ["seeded.yaml"]):
        _, data, _ = call_json(capsys, "solve", *given, "--quiet", "--workers", "1")
        drives.append(data)
    first, second = (one["results"][0]["objective"] for one in drives)
    assert first == second


@pytest.mark.parametrize("count", ["0", "99"])
def test_few_replicates_are_refused_in_words(capsys, folder: Path, count: str):
    saved = REPORTS / "choi_skid_steer"
    (folder / "made").mkdir()
    (folder / "made" / "record.json").write_bytes((saved / "record.json").read_bytes())
    code, _, err = call(capsys, "validate", "made", "--replicates", count, "--quiet", "--trust")
    assert (code, err) == (2, f"replicates: expected at least 100, got {count}\n")


@pytest.mark.parametrize("option", ["--noise position={}", "--size track={}"])
def test_a_first_study_of_no_number(capsys, folder: Path, option: str):
    """A number that is none was called a defect of the program."""
    given = ["init", "new.yaml", "--robot", "jackal", "--room", "4 m x 3 m", "--sensor", "poses"]
    for amount in ("nan", "inf", "-inf"):
        code, out, err = call(capsys, *given, *option.format(amount).split())
        assert (code, out) == (2, ""), amount
        assert amount.lstrip("-") in err
        assert "defect" not in err
        assert not (folder / "new.yaml").exists()


def test_a_size_that_yaml_takes_for_something_else(capsys, folder: Path):
    given = ["init", "new.yaml", "--robot", "differential_drive", "--room", "4 m x 3 m", "--sensor", "poses"]
    for size in ("#1", "[1", "a: b", "{"):
        code, _, err = call(capsys, *given, "--size", f"track={size}")
        assert code == 2, size
        assert f"track: expected a quantity, got {size!r}" in err


def test_designs_to_compare_with_that_are_not_there(capsys, folder: Path):
    """They were left out without a word."""
    code, out, err = call(capsys, "evaluate", "study.yaml", "path.csv", "--designs", "nowhere")
    assert (code, out) == (2, "")
    assert "nowhere" in err


@pytest.mark.slow
def test_more_memory_than_there_is(capsys, folder: Path, monkeypatch: pytest.MonkeyPatch):
    def huge(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 74.5 GiB")

    monkeypatch.setattr("oed.workflow.studies.load_study", huge)
    code, out, err = call(capsys, "solve", "study.yaml", "--quiet")
    assert (code, out) == (1, "")
    assert "Unable to allocate 74.5 GiB" in err
    assert "take fewer samples, points or coefficients" in err
