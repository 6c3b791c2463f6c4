"""What experiments may choose and must keep to in a study: durations, starts, trials, candidates, budgets."""

from __future__ import annotations

import textwrap
from functools import cache
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import pytest
from places import PROBLEMS
from scipy.integrate import quad, solve_ivp

import oed
from oed.foundation.errors import StudyError

TANK = (PROBLEMS / "heated_tank.yaml").read_text()
QUICK = oed.Ipopt(starts=1, perturbations=0, second_stage="none")
PARABOLA = textwrap.dedent("""\
    format: 1
    name: A parabola
    system:
      kind: equations
      inputs: {x: m}
      parameters: {a: 1, b: 1 1/m, c: 1 1/m^2}
      outputs: {y: a + b * x + c * x^2}
    experiment:
      candidates: {file: trials.csv}
    measurement: {kind: responses, noise: {y: 1}}
    weights: {readings: 5, most: 5}
    criterion: {kind: E, scaling: none}
    """)


def temperature(drive: oed.Trajectory) -> solve_ivp:
    """The tank's, by SciPy."""
    heat, period = drive.inputs[:, 0], drive.period

    def rate(time: float, state: np.ndarray) -> np.ndarray:
        return (heat[min(int(time / period), len(heat) - 1)] - 2 * (state - 293)) / 20e3

    return solve_ivp(rate, (0, drive.duration), [293.0], max_step=period / 2, rtol=1e-9, dense_output=True)


@pytest.mark.usefixtures("few_screened")
class TestTank:
    @staticmethod
    @cache
    def solved() -> tuple[oed.Study, oed.Solution]:
        """The study and its quick search's design."""
        study = oed.parse_study(TANK.replace("samples: 60", "samples: 24"))
        return study, oed.solve(study.problem, QUICK, seed=0)

    @pytest.mark.slow
    def test_its_limits_hold_by_another_integrator(self):
        _, solution = self.solved()
        drive = solution.trajectory
        assert solution.evaluation.feasible
        assert 3600 <= drive.duration < 14400 * 0.999
        followed = temperature(drive)
        times = np.linspace(0, drive.duration, 2000)
        assert followed.sol(times).max() < 343 + 0.01
        assert followed.y[0, -1] < 293 + 20 + 0.01
        assert (drive.inputs[:, 0] + 100).sum() * drive.period <= 2e6 * (1 + 1e-6)
        margins = {one.name: one for one in solution.evaluation.margins}
        assert margins["warm"].certain
        assert margins["energy"].active

    @pytest.mark.slow
    def test_a_shorter_one_is_what_it_is(self):
        """The duration that a search chose is the trajectory's own."""
        study, solution = self.solved()
        drive = solution.trajectory
        fixed = study.changed(experiment={**study.echo()["experiment"], "duration": drive.duration}).problem
        assert oed.evaluate(fixed, drive).objective == pytest.approx(
            oed.evaluate(study.problem, drive).objective, rel=1e-12
        )

    @pytest.mark.parametrize(
        ("old", "new", "said"),
        [
            ("of: temperature, range", "of: temperatur, range", "limits.0.of: column 1: unknown name"),
            ("range: [273 K, 343 K]", "range: [273 m, 343 m]", "limits.0: expected values in K"),
            ("range: [273 K, 343 K]", "range: [343 K, 273 K]", "limits.0.range: expected [least, largest]"),
            ("of: temperature, range: [273 K, 343 K]", "of: heat, range: [1 W, 2 W]", "depends on inputs"),
            ("most: 2 MJ", "most: 2 W", "limits.2: expected values in"),
            ("kind: always", "kind: never", "limits.0.kind"),
            ("name: warm", "name: energy", "given twice"),
            ("[1 h, 4 h]", "[4 h, 1 h]", "experiment.duration: expected [shortest, longest]"),
            ("500 W], signal", "500 W], rate: 1 W/s, signal", "is not known where the duration is chosen"),
            ("pieces: 6", "pieces: 600", "experiment.inputs.heat.signal"),
            (
                "piecewise_constant, pieces: 6",
                "spline, coefficients: auto",
                "heat.signal.coefficients: expected a whole number, got 'auto'",
            ),
        ],
    )
    def test_mistakes_are_named(self, old: str, new: str, said: str):
        assert old in TANK
        with pytest.raises(StudyError) as error:
            oed.parse_study(TANK.replace(old, new))
        assert said in str(error.value)


@pytest.mark.usefixtures("few_screened")
class TestStarts:
    @staticmethod
    def decay(start: str, trials: int = 1) -> oed.Study:
        """A decay from a start."""
        return oed.parse_study(
            textwrap.dedent(f"""\
                format: 1
                name: A decay
                system:
                  kind: equations
                  states: {{x: {start}, y: 0}}
                  inputs: {{u: 1/s}}
                  parameters: {{p: 1 1/s, q: 0.5 1/s}}
                  derivatives: {{x: u - p * x, y: p * x - q * y}}
                  outputs: {{seen: y}}
                experiment: {{duration: 5 s, samples: 10, trials: {trials}, inputs: {{u: [0 1/s, 1 1/s]}}}}
                measurement: {{kind: outputs, noise: {{seen: 0.01}}}}
                criterion: D
                """)
        )

    @classmethod
    @cache
    def designed(cls) -> oed.Trajectory:
        """A drive for a start that is known."""
        return oed.solve(cls.decay("1").problem, QUICK, seed=0).trajectory

    @pytest.mark.slow
    def test_designed_ones_are_each_trial_s_own(self):
        study = self.decay("{design: [0, 2]}", trials=2)
        solution = oed.solve(study.problem, QUICK, seed=0)
        assert solution.trajectory.starts[:, 0] == pytest.approx([2.0, 2.0], abs=1e-5)
        assert solution.trajectory.starts[:, 1] == pytest.approx([0.0, 0.0])

    @pytest.mark.slow
    def test_unknown_ones_cost_information(self):
        """As much as dense least squares with the start among the unknowns says."""
        known, unknown = self.decay("1"), self.decay("{unknown: 1, deviation: 0.1}")
        drive = self.designed()
        found = oed.evaluate(unknown.problem, drive)
        times = 0.5 * np.arange(11)

        def seen(values: np.ndarray) -> np.ndarray:
            p, q, x = values
            total = np.zeros(len(times))
            state = np.array([x, 0.0])
            for step, held in enumerate(drive.inputs[:, 0]):
                state = solve_ivp(
                    lambda _, now, held=held: [held - p * now[0], p * now[0] - q * now[1]],
                    (0, 0.5),
                    state,
                    rtol=1e-11,
                    atol=1e-12,
                ).y[:, -1]
                total[step + 1] = state[1]
            return total

        nominal = np.array([1.0, 0.5, 1.0])
        slopes = [(seen(nominal + step) - seen(nominal - step)) / 2e-5 for step in 1e-5 * np.eye(3)]
        whole = np.array(slopes) @ np.array(slopes).T / 0.01**2 + np.diag([0, 0, 0.1**-2])
        expected = np.sqrt(np.diag(np.linalg.inv(whole))[:2])
        assert list(found.standard_deviations.values()) == pytest.approx(expected, rel=1e-5)
        assert found.objective < oed.evaluate(known.problem, drive).objective

    @pytest.mark.slow
    def test_a_value_without_a_deviation_is_open(self):
        drive = self.designed()
        errors = [
            oed.evaluate(self.decay(start).problem, drive).standard_deviations["p"]
            for start in ("1", "{unknown: 1, deviation: 0.1}", "{unknown: 1}")
        ]
        assert errors == sorted(errors)

    def test_all_sensors_know_starts_alike_but_those_that_say_it_themselves(self):
        study = self.decay("{unknown: 1, deviation: 0.1}")
        (alone,) = study.problem.sensors
        assert dict(alone.start)["x"] == 0.1
        given = study.echo()["measurement"]
        rates = {"kind": "rates", "noise": given["noise"]}
        both = study.changed(measurement=[given, rates]).problem.measurement.sensors
        assert [one.kind for one in both] == ["outputs", "rates"]
        assert [one.start for one in both] == [alone.start] * 2
        own = study.changed(measurement={**given, "start": "unknown"}).problem.sensors[0]
        assert own.start == "unknown"


@pytest.mark.usefixtures("few_screened")
class TestStartsAlone:
    """Of a system without inputs nothing else is chosen."""

    TEXT = textwrap.dedent("""\
        format: 1
        name: A saturated decay
        system:
          kind: equations
          states: {x: {design: [1, 3]}}
          parameters: {v: 1 1/s, K: 1.5}
          derivatives: {x: -v * x / (K + x)}
          outputs: {y: x}
        experiment: {duration: 2 s, samples: 10, trials: 2}
        measurement: {kind: outputs, noise: {y: 0.01}}
        criterion: D
        """)

    @pytest.mark.slow
    def test_are_those_that_say_most(self):
        problem = oed.parse_study(self.TEXT).problem
        found = oed.solve(problem, QUICK, seed=0)
        assert found.evaluation.feasible
        grid = np.linspace(1, 3, 5)
        held = np.zeros((20, 0))
        # Of two trials either may be the first.
        each = [
            oed.evaluate(problem, problem.design.trajectory(held, [[one], [other]])).objective
            for one, other in combinations_with_replacement(grid, 2)
        ]
        assert found.evaluation.objective > max(each) - 1e-6

    def test_are_not_chosen_among_candidates(self):
        text = self.TEXT.replace(
            "experiment: {duration", "experiment: {candidates: {rows: {u: [1]}}, duration"
        )
        text = text.replace(", trials: 2", "").replace("parameters:", 'inputs: {u: ""}\n  parameters:')
        with pytest.raises(StudyError, match=r"5: system\.states\.x\.design: is not chosen among candidates"):
            oed.parse_study(text)


class TestCandidates:
    @pytest.mark.slow
    def test_a_file_s_rows_are_the_trials(self, tmp_path: Path):
        rows = "\n".join(f"{x:.2f} m" for x in np.linspace(-1, 1, 41))
        (tmp_path / "trials.csv").write_text(f"x\n{rows}\n")
        (tmp_path / "study.yaml").write_text(PARABOLA)
        study = oed.load_study(tmp_path / "study.yaml")
        best = oed.run(study, search_only=True).best
        taken = {one.time: one.weight for one in best.selection.readings if one.weight}
        assert [round(-1 + 0.05 * int(time), 2) for time in taken] == [-1, 0, 1]
        assert list(taken.values()) == [1, 3, 1]
        assert best.selection.efficiency == pytest.approx(1, abs=1e-6)
        # What it was read from is no longer needed.
        (tmp_path / "trials.csv").unlink()
        assert oed.parse_study(study.changed(seed=1).text).problem.design.samples == 41

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("t\n1\n", "1: the header lacks x"),
            ("x\n1\nno\n", "3: x: "),
            ("x\n", "expected at least one row"),
            ("x\n1 s\n", "x is in m, a value in s"),
        ],
    )
    def test_mistakes_in_it_are_named_by_their_lines(self, tmp_path: Path, text: str, said: str):
        (tmp_path / "trials.csv").write_text(text)
        (tmp_path / "study.yaml").write_text(PARABOLA)
        with pytest.raises(StudyError) as error:
            oed.load_study(tmp_path / "study.yaml")
        assert said in str(error.value)

    def test_one_that_says_too_little_is_scored_so(self, tmp_path: Path):
        """Of a single setting no parabola is identifiable, however it is weighted."""
        (tmp_path / "trials.csv").write_text("x\n-1 m\n0 m\n1 m\n")
        (tmp_path / "study.yaml").write_text(PARABOLA)
        (tmp_path / "one.csv").write_text("x\n0.5\n")
        study = oed.load_study(tmp_path / "study.yaml")
        found = oed.score_path(study, tmp_path / "one.csv").first.result
        assert not found.identifiable

    @pytest.mark.parametrize(
        ("candidates", "said"),
        [
            (
                "{grid: {x: {least: -1, largest: 1, count: 100000}, z: [0, 1]}}",
                "the system has no such input",
            ),
            ("{rows: {x: []}}", "expected at least one value"),
            ("{grid: {x: []}}", "expected at least one value"),
        ],
    )
    def test_lists_that_are_none_are_refused(self, candidates: str, said: str):
        with pytest.raises(StudyError, match=said):
            oed.parse_study(PARABOLA.replace("{file: trials.csv}", candidates))

    def test_there_is_a_largest_number_of_them(self):
        text = PARABOLA.replace("{x: m}", "{x: m, z: m}")
        values = "{least: 0 m, largest: 1 m, count: 1000}"
        text = text.replace("{file: trials.csv}", f"{{grid: {{x: {values}, z: {values}}}}}")
        with pytest.raises(StudyError, match="expected at most 100000 candidates, got 1000000"):
            oed.parse_study(text)

    @pytest.mark.slow
    def test_settings_may_share_a_budget(self):
        """Two points whose sum is limited: of a line through 0 both at their most."""
        study = oed.parse_study(
            textwrap.dedent("""\
                format: 1
                name: A line
                system:
                  kind: equations
                  inputs: {x: m}
                  parameters: {slope: 2 1/m}
                  outputs: {y: slope * x}
                experiment: {points: 2, inputs: {x: [0 m, 3 m]}}
                limits: [{kind: budget, name: length, of: x, most: 4 m}]
                measurement: {kind: responses, noise: {y: 1}}
                criterion: {kind: E, scaling: none}
                """)
        )
        points = np.sort(oed.solve(study.problem, QUICK, seed=0).trajectory.inputs.ravel())
        assert points == pytest.approx([1, 3], abs=1e-4)


@pytest.mark.slow
def test_rates_are_integrals_of_what_is_read():
    """F of x = exp(p t), read all the time: the integral of its squared sensitivity."""
    study = oed.load_study(PROBLEMS / "published" / "decay_weights.yaml")
    drive = study.problem.design.only
    every = study.changed(weights=None).problem
    expected = quad(lambda time: (time * np.exp(-2 * time)) ** 2, 0, 1)[0]
    noise = every.sensors[0].sizes[0]
    assert oed.evaluate(every, drive).lambda_min * noise**2 == pytest.approx(expected, rel=1e-5)


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
def test_a_coarse_integration_is_named():
    """One Runge-Kutta step a period of nearly its time constant."""
    keys = {
        "validation": {"replicates": 100},
        # Any drive will do.
        "solvers": [
            {"kind": "ipopt", "starts": 1, "perturbations": 0, "second_stage": "none", "max_iterations": 5}
        ],
    }
    text = TANK.replace("  outputs:", "  substeps: 1\n  outputs:").replace("samples: 60", "samples: 3")
    coarse = oed.parse_study(text.replace("[1 h, 4 h]", "9 h").replace("pieces: 6", "pieces: 3"))
    (note,) = oed.run(coarse.changed(limits=[], **keys)).notes
    assert note.startswith("The integration steps of the study are coarse: ")
    fine = oed.parse_study(TANK.replace("samples: 60", "samples: 12"))
    assert oed.run(fine.changed(**keys)).notes == []


def test_a_study_is_of_a_robot_or_of_a_system():
    with pytest.raises(StudyError, match="not of both"):
        oed.parse_study(TANK + "robot: {kind: unicycle}\n")
