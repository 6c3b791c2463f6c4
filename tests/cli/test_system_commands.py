"""Every command on studies of systems: it does what it says, or says that it is for robots."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from places import PROBLEMS

import oed
from oed.cli import main
from oed.exporters import EXPORTERS
from oed.foundation.vocabulary import spoken

ROBOTS = re.compile(r"\b(drives?|robots?|wheels?|paths?|driven|turns? in place)\b", re.IGNORECASE)
BOX_LUCAS = str(PROBLEMS / "published" / "box_lucas.yaml")


# Whatever is on a page of words; the figures are drawn in tests of reports.
pytestmark = pytest.mark.usefixtures("blank_figures")


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Records of a tank, and of points."""
    folder = tmp_path_factory.mktemp("systems")
    for name, file in (("tank", PROBLEMS / "heated_tank.yaml"), ("points", Path(BOX_LUCAS))):
        # The tank with fewer samples and pieces; the points have as many as they have.
        text = file.read_text().replace("samples: 60", "samples: 6").replace("pieces: 6", "pieces: 3")
        study = oed.parse_study(text).changed(
            solvers=[{"kind": "ipopt", "starts": 1, "perturbations": 0, "second_stage": "none"}],
            validation={"replicates": 100},
        )
        (folder / f"{name}.yaml").write_text(study.text)
        oed.run(study, folder / name, workers=1)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tank", "points"])
def test_pages_and_terminals_speak_of_experiments(saved: Path, capsys: pytest.CaptureFixture[str], name: str):
    study, record = str(saved / f"{name}.yaml"), str(saved / name)
    for command in (
        ["check", study],
        ["solve", study, "--quiet", "--verbose"],
        ["report", record],
        ["validate", record, "--replicates", "100", "--quiet"],
        ["evaluate", study, f"{record}/ipopt.csv", "--designs", record],
    ):
        assert main(command) == 0, capsys.readouterr()
        said = capsys.readouterr()
        assert not ROBOTS.search(said.out.replace(str(saved), ""))
        assert not ROBOTS.search(said.err.replace(str(saved), ""))
    page = (saved / name / "report.md").read_text()
    assert not ROBOTS.findall(re.sub(r"`[^`]*`|\(figures/[^)]*\)|```.*?```", "", page, flags=re.DOTALL))


@pytest.mark.slow
def test_an_index_says_that_it_is_of_systems(saved: Path, tmp_path: Path):
    assert main(["report", str(saved), "--out", str(tmp_path)]) == 0
    assert "| Study | Run | What | System | Standard errors |" in (tmp_path / "index.md").read_text()


@pytest.mark.slow
def test_what_is_found_first_is_said_in_the_units_of_the_study(
    saved: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["solve", str(saved / "points.yaml")]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert re.search(r"first feasible experiment after .* standard errors k1 [\d.]+ 1/min", said)


@pytest.mark.slow
def test_several_are_compared(saved: Path, tmp_path: Path):
    assert main(["report", str(saved / "tank"), str(saved / "points"), "--out", str(tmp_path / "both")]) == 0
    assert not ROBOTS.search(re.sub(r"`[^`]*`", "", (tmp_path / "both" / "report.md").read_text()))
    swept = ["sweep", str(saved / "points.yaml"), "--over", "measurement.noise.b=0.01,0.02", "--quiet"]
    swept += ["--workers", "1"]
    assert main([*swept, "--out", str(tmp_path / "sweep")]) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        *(["export", "{record}", "--to", form] for form in EXPORTERS),
        ["animate", "{record}"],
        ["animate", "{record}", "--physics"],
        ["next", "{record}", "log.csv"],
        ["estimate", "{study}", "log.csv"],
        ["plan", "{study}", "--to", "loss 1 %"],
        ["loop", "{study}", "--target", "loss 1 %", "--logs", "."],
    ],
    ids=" ".join,
)
def test_what_is_for_robots_says_so(saved: Path, capsys: pytest.CaptureFixture[str], command: list[str]):
    given = {"record": str(saved / "tank"), "study": str(saved / "tank.yaml")}
    assert main([one.format(**given) for one in command]) == 2
    assert "this is for studies of robots" in capsys.readouterr().err


def test_what_was_designed_is_scored_again(saved: Path):
    """A design's CSV file says all that its score needs."""
    for name in ("tank", "points"):
        study = oed.load_study(saved / f"{name}.yaml")
        best = oed.load_record(saved / name).best
        again = oed.score_path(study, saved / name / "ipopt.csv").first.result
        assert again.objective == pytest.approx(best.objective, rel=1e-9)
        assert again.feasible


@pytest.mark.slow
def test_a_file_of_another_experiment_is_refused_in_its_own_words(
    saved: Path, capsys: pytest.CaptureFixture[str]
):
    """Of what it lacks, and of a file that was cut short."""
    tank = saved / "tank.yaml"
    assert main(["evaluate", str(tank), str(saved / "points" / "ipopt.csv")]) == 2
    said = capsys.readouterr().err
    assert "the header lacks heat; expected an experiment with the columns t, heat" in said
    rows = (saved / "tank" / "ipopt.csv").read_text().splitlines()
    (saved / "cut.csv").write_text("\n".join(rows[:-1]) + "\n")
    assert main(["evaluate", str(tank), str(saved / "cut.csv")]) == 2
    assert "with the final state and no inputs, is missing" in capsys.readouterr().err


@pytest.mark.slow
def test_the_words_of_a_command_end_with_it(saved: Path):
    """What is called next may be about a robot."""
    assert main(["solve", str(saved / "points.yaml"), "--quiet"]) == 0
    assert spoken("a drive") == "a drive"
