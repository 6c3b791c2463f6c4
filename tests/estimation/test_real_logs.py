"""Logs of real robots, where they are at hand: other people's data, which the project does not carry.

They are looked for beside the project, in shared/data, or where the environment variable OED_LOGS says:
optiodom_differential and optiodom_tricycle (github.com/sousarbarb/optiodom), norlab_drive
(github.com/norlab-ulaval/DRIVE).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import PROBLEMS, ROOT

from oed.estimation import Calibration, CalibrationOptions, calibrate
from oed.estimation.assessment.by_likelihood import covariance_of, likeliest
from oed.estimation.assessment.covariance import Covariance
from oed.estimation.assessment.trusted_covariance import covariances_of
from oed.logs import read_logs
from oed.study.study import Study
from oed.workflow.estimate_logs import estimate
from oed.workflow.studies import load_study, parse_study

DATA = Path(os.environ.get("OED_LOGS", ROOT.parent / "shared" / "data"))

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.is_dir(), reason="the logs of real robots are not beside the project"),
]

SESSIONS = (
    ("square", "230620202042"),
    ("square", "230620202144"),
    ("square", "231220200029"),
    ("square", "231220200040"),
    ("free", "030120210006"),
)
"""Each of several runs of one path."""
CIRCLES = (("circular", "250620202104"), ("circular", "250620202236"))
"""Alike, of circles in one direction."""
OFF_CLOCK = {"231220200029_run-02", "030120210006_run-03"}
"""Runs whose encoders are known to be off the motion capture's clock."""


def study_of(name: str, **calibration: Any) -> Study:
    study = load_study(PROBLEMS / f"{name}.yaml")
    if not calibration:
        return study
    keys = ", ".join(f"{key}: {value}" for key, value in calibration.items())
    return parse_study(f"{study.text}\ncalibration: {{{keys}}}\n", study.source)


def runs_of(kind: str, session: str, robot: str = "differential") -> list[Path]:
    return sorted((DATA / f"optiodom_{robot}" / kind / session).glob("*_run-*.csv"))


def entry(found: Any, name: str) -> dict[str, Any]:
    entries = [*found.data["parameters"], *found.data["coefficients"]]
    return next(one for one in entries if one["name"] == name)


def meets(found: Any, name: str, low: float, high: float) -> bool:
    """Whether a parameter's 95 % interval meets a range."""
    first, last = entry(found, name)["interval"]
    return first <= high and last >= low


@cache
def fitted(run: Path) -> Calibration:
    """A run by itself, by the defaults: what several tests judge in ways of their own."""
    study = study_of("optiodom_differential")
    logs = read_logs([run], study.log, study.problem.model)
    return calibrate(study.problem, logs, study.calibration, seed=study.seed)


def fitted_runs(path: str, session: str) -> list[Calibration]:
    return [fitted(run) for run in runs_of(path, session) if run.stem not in OFF_CLOCK]


def in_use(found: Calibration) -> Covariance:
    return found.covariances[0]


def information(found: Calibration) -> Covariance:
    return next(one for one in found.covariances if one.name == "information")


def bootstrap(found: Calibration) -> Covariance:
    """As it is where it is asked for."""
    asked = CalibrationOptions(covariance="bootstrap")
    return covariances_of(found.fit, asked, found.drift, drifts=found.drifts, seed=0)[0]


def scatter(
    sessions: tuple[tuple[str, str], ...], *ways: Callable[[Calibration], Covariance]
) -> list[np.ndarray]:
    """How much estimates of single runs scatter in units of their standard errors, (p,), by each way."""
    ratios: list[list[np.ndarray]] = [[] for _ in ways]
    for path, session in sessions:
        each = fitted_runs(path, session)
        variance = np.array([one.values for one in each]).var(axis=0, ddof=1)
        for way, found in zip(ways, ratios, strict=True):
            errors = np.array([way(one).deviations[: len(variance)] for one in each])
            found.append(variance / (errors**2).mean(axis=0))
    return [np.sqrt(np.mean(found, axis=0)) for found in ratios]


@pytest.fixture(scope="module")
def squares() -> Any:
    apart = runs_of("free", "030120210006")
    return estimate(study_of("optiodom_differential"), runs_of("square", "231220200029"), apart=apart)


class TestDifferentialDrive:
    def test_agrees_with_a_careful_regression(self, squares):
        # Two-stage least squares on windows of 1 s gave r 41.8-41.9 mm, B 201-203 mm.
        for side in ("right", "left"):
            assert meets(squares, f"wheel_radius_{side}", 0.0418, 0.0419)
        assert meets(squares, "track", 0.201, 0.203)

    def test_dead_reckoning_of_free_drives_improves(self, squares):
        means = squares.data["held_out"]["mean"]
        for number in ("rmse_position", "rmse_heading", "end_position"):
            assert means["after"][number] < 0.6 * means["before"][number]

    def test_finds_clocks_that_are_apart(self):
        study = study_of("optiodom_differential", segment="2 s")
        each = {run.stem: estimate(study, [run]) for run in runs_of("free", "030120210006")}
        offsets = {name: found.data["logs"][0]["clock_offset"] for name, found in each.items()}
        assert offsets.pop("030120210006_run-03") == pytest.approx(0.34, abs=0.04)
        assert max(map(abs, offsets.values())) < 0.1
        values = {name: entry(found, "c11")["value"] for name, found in each.items()}
        repaired = values.pop("030120210006_run-03")
        assert repaired == pytest.approx(np.mean(list(values.values())), rel=0.01)

    def test_standard_errors_agree_with_the_scatter_of_runs(self):
        of_blocks, white = scatter(SESSIONS, bootstrap, information)
        assert np.all((of_blocks > 1 / 1.5) & (of_blocks < 1.5))
        assert np.all(white > 1.5)

    def test_default_standard_errors_are_not_smaller_than_the_scatter_of_runs(self):
        # A run's errors that all runs have in common show in its residuals, and not in this scatter; and a
        # bootstrap that is chosen, not asked for, is no surer than noise and drift leave it.
        (ratios,) = scatter(SESSIONS, in_use)
        assert np.all((ratios > 0.4) & (ratios < 1.1))

    def test_f_inverse_under_drift_agrees_with_the_scatter_of_runs(self):
        # Pooled over sessions by their degrees of freedom, and all runs as those of one robot. Whole logs by
        # likelihood begin with the fit that is there already.
        study, each = study_of("optiodom_differential", method="likelihood"), []
        for path, session in SESSIONS:
            runs = [
                likeliest(one.fit, study.calibration, study.problem.measurement)
                for one in fitted_runs(path, session)
            ]
            errors = np.array([covariance_of(run).deviations[:3] for run in runs])
            each.append((np.array([run.fit.values[:3] for run in runs]), errors))
        squares = sum((((values - values.mean(axis=0)) / errors) ** 2).sum(axis=0) for values, errors in each)
        within = np.sqrt(squares / sum(len(values) - 1 for values, _ in each))
        assert np.all((within > 0.7) & (within < 1.4))
        values, errors = (np.vstack(part) for part in zip(*each, strict=True))
        mean = (values / errors**2).sum(axis=0) / (1 / errors**2).sum(axis=0)
        whole = np.sqrt((((values - mean) / errors) ** 2).sum(axis=0) / (len(values) - 1))
        assert np.all((whole > 0.7) & (whole < 1.7))

    def test_what_is_compared_is_what_an_estimate_says(self):
        # But for what noise of the inputs adds.
        run = runs_of(*SESSIONS[0])[0]
        whole = study_of("optiodom_differential", method="likelihood")
        found = likeliest(fitted(run).fit, whole.calibration, whole.problem.measurement)
        for study, values, own in (
            (study_of("optiodom_differential"), fitted(run).values, information(fitted(run))),
            (whole, found.fit.values, covariance_of(found)),
        ):
            said = estimate(study, [run])
            assert list(said.values.values()) == pytest.approx(values[:3], rel=1e-9)
            for one, error in zip(said.parameters, own.deviations, strict=False):
                assert error * (1 - 1e-9) <= one.error("information") < 1.05 * error

    def test_so_do_those_of_circles_in_one_direction(self):
        chosen, white = scatter(CIRCLES, in_use, information)
        assert np.all((chosen > 1 / 1.5) & (chosen < 1.5))
        assert np.all(white > 4)


def every_third(file: Path, folder: Path) -> Path:
    """A file with every third of the windows in which a robot drives steadily."""
    head, *rows = file.read_text().splitlines()
    steady = {}
    for row in rows:
        window, _, is_steady, _ = row.split(",", 3)
        if is_steady == "1":
            steady.setdefault(window, []).append(row)
    kept = [row for window in list(steady.values())[::3] for row in window]
    less = folder / file.name
    less.write_text("\n".join([head, *kept]) + "\n")
    return less


class TestOtherRobots:
    def test_tricycle(self):
        runs = [
            run
            for session in ("140120211500", "140120211543")
            for run in runs_of("square", session, "tricycle")
        ]
        found = estimate(study_of("optiodom_tricycle"), runs)
        # A regression gave a wheel diameter of 63.5-64.3 mm, a wheelbase of 156-165 mm, -1.2 deg.
        assert meets(found, "wheel_radius", 0.03175, 0.03215)
        assert meets(found, "wheelbase", 0.156, 0.165)
        assert np.rad2deg(entry(found, "steering_offset")["value"]) == pytest.approx(-1.2, abs=0.2)

    @pytest.mark.parametrize(("robot", "track", "wider"), [("husky", 1.15, 2.1), ("warthog", 1.69, 1.56)])
    def test_skid_steer_turns_as_if_it_were_wider(self, robot, track, wider, tmp_path):
        study = study_of(f"norlab_{robot}")
        found = estimate(study, [every_third(DATA / "norlab_drive" / f"{robot}_windows.csv", tmp_path)])
        effective, nominal = entry(found, "effective_track")["value"], study.problem.model
        assert effective == pytest.approx(track, rel=0.04)
        assert effective / (nominal.y_icr_left - nominal.y_icr_right) == pytest.approx(wider, rel=0.04)


def test_windows_whose_clock_lies_in_a_corner_converge():
    # Variances and the last run's clock led each other to and fro by a fifth of its standard error.
    study = study_of("optiodom_tricycle")
    short = parse_study(study.text.replace("method: gls", "method: gls, segment: 1 s"), study.source)
    assert estimate(short, runs_of("square", "140120211500", "tricycle")).converged
