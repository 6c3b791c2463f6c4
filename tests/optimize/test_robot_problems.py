"""The shipped problems of other robots, rooms and runs: solved, scored again, above all their baselines."""

from __future__ import annotations

import re

import numpy as np
import pytest
import shapely
import yaml
from places import PROBLEMS

from oed.kernel.results import Evaluation
from oed.optimize import Ipopt, solve
from oed.robots.baselines import baselines
from oed.robots.models import MODELS
from oed.study.study import Study
from oed.workflow.studies import parse_study

CLOSEST: dict[str, str] = {
    "ackermann": "rounded_square",
    "obstacle_course": "straight_and_spin",
    "offset_marker": "figure_eight",
    "omni_three": "circle",
    "own_robot": "straight_and_spin",
    "skid_steer_icr": "figure_eight",
    "skid_steer_slip": "straight_and_spin",
    "three_runs": "circle",
    "tractor_trailer": "random",
    "unicycle": "straight",
}
"""Of each study's everyday paths the one that tells most; the others come to less still. A mecanum robot is
an `omni_three` with another matrix; gains are of the search of a `tricycle`, steered as an `ackermann` is.
"""

SLOW = ("ackermann", "obstacle_course", "omni_three", "three_runs")
"""Those whose searches are above it after a hundred iterations; the others' are after a fourth of them."""

pytestmark = pytest.mark.usefixtures("few_screened")


def solved(name: str, share: int = 8, coefficients: int = 7) -> tuple[Study, Evaluation]:
    # Fewer samples and coefficients: the same problem in a sixth of the time. Paths that stop to steer need
    # a fourth of the samples.
    text = (PROBLEMS / f"{name}.yaml").read_text()
    share = 4 if "steering_angle" in text else share
    text = re.sub(r"samples: (\d+)\n", lambda found: f"samples: {int(found[1]) // share}\n", text)
    text = re.sub(r"coefficients: \d{2,}", f"coefficients: {coefficients}", text)
    study = parse_study(text, str(PROBLEMS / f"{name}.yaml"))
    iterations = 100 if name in SLOW else 25
    few = Ipopt(starts=1, perturbations=0, second_stage="none", max_iterations=iterations)
    found = solve(study.problem, few, seed=study.seed, workers=1)
    assert found.evaluation is not None
    return study, found.evaluation


@pytest.mark.slow
def test_every_robot_has_a_problem():
    files = [yaml.safe_load(file.read_text()) for file in PROBLEMS.glob("*.yaml")]
    kinds = {one["robot"].get("kind") for one in files if "robot" in one}
    assert {model.model_fields["kind"].default for model in MODELS} <= kinds


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CLOSEST if name not in ("obstacle_course", "three_runs")])
def test_designs_are_above_all_everyday_paths(name: str):
    study, design = solved(name)
    assert_above_all_paths(name, study, design)


def assert_above_all_paths(name: str, study: Study, design: Evaluation) -> None:
    assert design.feasible
    assert CLOSEST[name] in study.file.baselines
    (plain,) = baselines(study.problem, CLOSEST[name], seed=study.seed)
    assert plain.evaluation is not None
    assert plain.evaluation.feasible
    assert design.objective > plain.evaluation.objective


@pytest.mark.slow
def test_a_room_with_a_corner_and_two_obstacles():
    study, design = solved("obstacle_course", 4, 8)
    assert_above_all_paths("obstacle_course", study, design)
    # On the fine grid the body, a disc, touches neither walls nor obstacles, by an independent geometry.
    limits = study.echo()["limits"]
    room = shapely.Polygon(limits["workspace"]["points"])
    column, table = limits["obstacles"]["shapes"]
    for taken in (shapely.Point(column["x"], column["y"]).buffer(column["radius"], 64), table["points"]):
        room = room.difference(shapely.Polygon(taken))
    body = study.problem.model.body_radius
    places = shapely.points(design.path[:, :2])
    assert shapely.contains(room, places).all()
    assert shapely.distance(places, room.boundary).min() >= body - 1e-3
    assert np.hypot(*(design.path[-1, :2] - design.path[0, :2])) <= 0.0101 * np.sqrt(2)


@pytest.mark.slow
def test_every_run_begins_in_the_room_and_keeps_to_its_length():
    study, design = solved("three_runs")
    assert_above_all_paths("three_runs", study, design)
    runs = np.split(design.path, study.problem.design.runs)
    body = study.problem.model.body_radius
    for path in runs:
        assert np.abs(path[:, :2]).max() <= 0.75 - body + 1e-3
        assert np.hypot(*np.diff(path[:, :2], axis=0).T).sum() <= 3.0 * 1.001
    starts = np.array([path[0, :3] for path in runs])
    assert len(np.unique(starts.round(3), axis=0)) == 3
