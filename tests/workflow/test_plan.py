"""A plan: how long, or how many drives, for a wanted precision."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from listeners import Listener, interrupt
from studies import SMALL, small, write_study

from oed.cli import main
from oed.cli.terminal.arguments import aim, durations
from oed.foundation.errors import UserMistake
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.records.record import load_plan, load_record
from oed.report import write_plan
from oed.workflow import plan as planning
from oed.workflow.aims import aims_of
from oed.workflow.plan import Planned, _answer, _in_room, _noisy, _reaching, plan
from oed.workflow.repeated import drives_needed, information_of, standard_errors
from oed.workflow.studies import load_study, parse_study

pytestmark = pytest.mark.usefixtures("drawn_once")

TINY = "{kind: genetic, population: 20, generations: 3}"


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Planned]:
    folder = tmp_path_factory.mktemp("plan")
    file = write_study(folder, small(solvers=TINY))
    return file, plan(file, {"c21": "0.1 mm", "c22": "1 %"}, folder / "out", durations=(10.0, 5.0), workers=1)


@pytest.mark.slow
def test_a_plan(planned: tuple[Path, Planned]):
    found = planned[1].found
    assert [(one.name, one.base) for one in found.axes] == [("duration", 10.0), ("room", 2.0), ("noise", 1.0)]
    short, own = found.axes[0].points
    assert (short.value, own.value, found.duration) == (5.0, 10.0, 10.0)
    # Noise twice as large: the same drive, and errors twice as large.
    half, double = found.axes[2].points
    for point, factor in ((half, 0.5), (double, 2.0)):
        assert point.errors == pytest.approx(
            {name: factor * size for name, size in own.errors.items()}, rel=1e-6
        )
    wanted = {one.name: one.wanted for one in found.aims}
    assert wanted == pytest.approx({"c21": 1e-4, "c22": 0.01 * 0.0245})
    assert own.worst == pytest.approx(max(own.errors[name] / size for name, size in wanted.items()))
    # So many drives are enough, and one fewer is not.
    assert own.worst / own.drives**0.5 <= 1 < own.worst / (own.drives - 1) ** 0.5
    assert found.answer.startswith(f"{own.drives} drives of 10 s.")


@pytest.mark.slow
def test_the_command_goes_on_where_it_was_and_writes_a_page(
    planned: tuple[Path, Planned], capsys: pytest.CaptureFixture[str]
):
    file, done = planned
    flags = ["--to", "c21 0.1 mm", "--to", "c22 = 1 %", "--durations", "5,10 s", "--workers", "1", "--quiet"]
    assert main(["plan", str(file), *flags, "--out", str(done.folder), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data.pop("directory") == str(done.folder)
    assert data == done.data == json.loads((done.folder / "plan.json").read_text())
    page = (done.folder / "report.html").read_text()
    # The first sentence is a heading.
    title, _, more = done.found.answer.partition(". ")
    assert re.search(rf"<h2>{re.escape(title.rstrip('.'))}</h2>", page.replace("\u00a0", " "))
    assert more in page.replace("\u00a0", " ")
    assert "duration of the drive" in page
    assert write_plan(done.found, done.folder).read_text() == page


@pytest.mark.slow
def test_its_page_is_drawn_again_and_an_index_lists_it(
    planned: tuple[Path, Planned], capsys: pytest.CaptureFixture[str]
):
    done = planned[1]
    assert load_plan(done.folder) == done.found
    page = write_plan(done.found, done.folder).read_text()
    (done.folder / "report.html").unlink()
    assert main(["report", str(done.folder), "--figures", "png"]) == 0
    assert (done.folder / "report.html").read_text() == page
    assert (done.folder / "figures" / "precision.png").exists()
    assert main(["report", str(done.folder.parent)]) == 0
    index = (done.folder.parent / "index.md").read_text()
    # Its sweeps are no runs of their own.
    (row,) = (line for line in index.splitlines() if "differential drive" in line)
    assert "| plan |" in row
    capsys.readouterr()


def a_prior(text: str, size: float) -> str:
    weighted = text.replace("scaling: none", "scaling: relative")
    return f"{weighted}prior: {{standard_deviations: {{c21: {size} m, c22: {size} m}}}}\n"


class TestSeveralDrives:
    def problem(self, size: float):
        problem = parse_study(a_prior(small(), size)).problem
        inputs = np.sin(np.arange(40)[:, None] / 9 + np.arange(2))
        return problem, Trajectory.from_samples(inputs, 10.0, problem.start_states(np.zeros(3)))

    def test_what_is_known_beforehand_counts_once(self):
        problem, drive = self.problem(1e-3)
        information = information_of(problem, drive)
        evaluation = evaluate(problem, drive)
        assert standard_errors(problem, information, 1) == pytest.approx(evaluation.standard_deviations)
        known = 1e-3**-2
        for name, whole in evaluation.full_information.items():
            alone = whole - known * np.eye(len(whole))
            expected = np.sqrt(np.diag(np.linalg.inv(2 * alone + known * np.eye(len(whole)))))
            found = standard_errors(problem, information, 2)
            assert [found[one] for one in evaluation.parameters[name]] == pytest.approx(expected)

    @pytest.mark.parametrize("share", [0.9, 0.5, 0.1])
    def test_no_fewer_would_do(self, share: float):
        problem, drive = self.problem(1e-3)
        information = information_of(problem, drive)
        wanted = {"c21": share * standard_errors(problem, information, 1)["c21"]}
        needed = drives_needed(problem, information, wanted)
        assert needed is not None
        errors = [standard_errors(problem, information, count)["c21"] for count in (needed, needed - 1)]
        assert errors[0] <= wanted["c21"] < errors[1]
        # A prior that counted in every drive would make it look as if fewer did.
        assert needed > share**-2

    def test_what_only_a_prior_says_no_drive_makes_better(self):
        problem, drive = self.problem(1e-3)
        still = Trajectory.from_samples(0 * drive.inputs, 10.0, drive.start)
        assert drives_needed(problem, information_of(problem, still), {"c21": 0.9e-3}) is None
        assert drives_needed(problem, information_of(problem, still), {"c21": 1e-3}) == 1


@pytest.mark.slow
def test_a_prior_counts_once_in_a_plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(planning, "ROOMS", ())
    file = write_study(tmp_path, a_prior(small(solvers=TINY), 1e-4))
    found = plan(file, {"c21": "0.03 mm"}, tmp_path / "out", durations=(10.0,), workers=1).found
    (own,) = found.axes[0].points
    problem, drive = load_study(file).problem, load_record(tmp_path / "out" / own.folder).best.drive
    assert found.drives == own.drives
    assert found.drives > own.worst**2 + 1
    assert found.drives == drives_needed(problem, information_of(problem, drive.trajectory), {"c21": 3e-5})


@pytest.mark.slow
def test_a_robust_study_is_searched_once_a_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(planning, "ROOMS", ())
    robust = "uncertainty: {wheel_radius_right: 1 %}\nrobust: {draws: 400, confidence: 0.98}\n"
    quick = "{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}"
    file = write_study(tmp_path, small(solvers=quick).replace("samples: 40", "samples: 20") + robust)
    found = plan(file, {"c21": "0.1 mm"}, tmp_path / "out", durations=(10.0,), workers=1).found
    (own,) = found.axes[0].points
    (result,) = load_record(tmp_path / "out" / own.folder).results
    assert result.name == "ipopt"
    assert [point.folder for point in found.axes[1].points] == [own.folder] * 2


@pytest.mark.slow
def test_an_interrupted_plan_leaves_a_finished_one(planned: tuple[Path, Planned], tmp_path: Path):
    file, done = planned
    before = (done.folder / "plan.json").read_text()
    more = {"durations": (2.5, 10.0, 5.0), "workers": 1, "progress": Listener(1, interrupt)}
    cut = plan(file, {"c21": "0.1 mm"}, done.folder, **more)
    assert cut.found.interrupted
    assert cut.folder is None
    assert (done.folder / "plan.json").read_text() == before
    fresh = plan(file, {"c21": "0.1 mm"}, tmp_path / "out", **more | {"progress": Listener(1, interrupt)})
    assert fresh.folder is not None
    assert load_plan(fresh.folder).interrupted
    assert fresh.found.axes[0].points


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([(10.0, 0.5), (20.0, 0.2)], 10.0),
        ([(10.0, 2.0), (20.0, 1.0)], 20.0),
        ([(10.0, 2.0), (40.0, 0.5)], 20.0),
        ([(10.0, 3.0), (20.0, 2.0)], None),
        ([], None),
    ],
)
def test_where_one_drive_is_enough(points: list[tuple[float, float]], expected: float | None):
    assert _reaching(points) == (None if expected is None else pytest.approx(expected))


@pytest.mark.parametrize(
    ("found", "one", "base", "answer"),
    [
        ([(20.0, 1.6, 3), (40.0, 0.9, 1)], 34.0, 0, "One drive of about 34 s, or 3 of 20 s."),
        ([(10.0, 1.6, 3), (20.0, 0.9, 1)], 17.0, 1, "One drive of 20 s is enough, and about 17 s would do."),
        ([(20.0, 2.6, 7)], None, 0, "7 drives of 20 s. One alone would have to be longer than 20 s: "),
        ([(20.0, 0.6, 1)], 20.0, 0, "One drive of 20 s is enough."),
        ([(20.0, 1.6, None)], None, 0, "No number of drives of 20 s is enough: "),
    ],
)
def test_the_answer_in_a_sentence(found: list, one: float | None, base: int, answer: str):
    assert _answer(found, one, found[base]).startswith(answer)


def test_all_that_has_a_place_moves_with_the_room():
    text = small(seed=0).replace("samples: 40", "samples: 40, start: {x: 0.5 m, y: 0 m, heading: 1 rad}")
    data = _in_room(parse_study(text), 2.0)
    assert data["limits"]["workspace"]["x"] == [-2.0, 2.0]
    assert data["trajectory"]["start"] == {"x": 1.0, "y": 0.0, "heading": 1.0}


def test_a_covariance_grows_with_the_square():
    covariance = "{kind: poses, quantities: [x, y], noise: {covariance: [[1e-4, 0], [0, 4e-4]]}}"
    text = small().replace(SMALL.splitlines()[4], f"measurement: {covariance}").replace("scaling: none", "")
    assert _noisy(parse_study(text), 3.0)["measurement"]["noise"]["covariance"][1][1] == pytest.approx(36e-4)


class TestMistakes:
    @pytest.mark.parametrize(
        ("to", "words"),
        [
            ("c2 1 %", "expected one of c21, c22; did you mean c2"),
            ("c21 1 s", "expected"),
            ("c21 -1 %", "more than 0"),
        ],
    )
    def test_what_is_wanted(self, to: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
        file = write_study(tmp_path, small())
        assert main(["plan", str(file), "--to", to, "--out", str(tmp_path / "out")]) == 2
        assert words in capsys.readouterr().err
        assert not (tmp_path / "out").exists()

    def test_a_study_without_noise(self, tmp_path: Path):
        text = small().replace(", noise: {position: 1 cm, heading: 1 deg}", "")
        with pytest.raises(UserMistake, match=r"measurement\.noise"):
            plan(write_study(tmp_path, text), {"c21": "1 %"}, tmp_path / "out")

    def test_what_is_no_aim(self, capsys: pytest.CaptureFixture[str]):
        with pytest.raises(SystemExit):
            main(["plan", "study.yaml", "--to", "precise"])
        assert "expected PARAMETER SIZE, e.g. 'track 0.1 %'" in capsys.readouterr().err


def test_a_pair_of_wheels_has_one_name(tmp_path: Path):
    text = small().replace(
        SMALL.splitlines()[4], "measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}"
    )
    study = load_study(write_study(tmp_path, text.replace("scaling: none", "scaling: relative")))
    assert list(aims_of(study, dict([aim("wheel radius 0.1 %")]), "--to")) == [
        "wheel_radius_right",
        "wheel_radius_left",
    ]


@pytest.mark.parametrize(("text", "times"), [("5,10 s", (5, 10)), ("5 s, 1 min", (5, 60)), ("7", (7,))])
def test_durations(text: str, times: tuple[float, ...]):
    assert durations(text) == times


@pytest.mark.slow
def test_every_table_has_the_studys_own_drive(planned: tuple[Path, Planned]):
    page = write_plan(planned[1].found, planned[1].folder).with_suffix(".md").read_text()
    rows = [line for line in page.splitlines() if line.startswith("|")]
    own = [row.split("|")[1:] for row in rows if row.split("|")[1].strip() in ("10", "2", "1")]
    # 10 s, 2 m, the study's noise, and twice it, of other errors.
    assert len(own) == 4
    assert sum(row[1:] == own[0][1:] for row in own) == 3
