"""What a report says of sensors, priors, other criteria and several estimators."""

from __future__ import annotations

import math
import pickle
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import pytest
import sample_records
from places import REPORTS
from recorded import record_from
from shown_in import column, section, text_of

from oed.foundation.errors import RecordError
from oed.kernel.criteria import E
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.sensor import Moment, Sensor
from oed.kernel.measurement.square_root import SquareRoot
from oed.records.record import Record, load_record
from oed.report import write_comparison
from oed.report.figures.draw import drawn
from oed.report.page import sections_of
from oed.report.parts.judging import aim_of, by_aim, repeatable, repetitions_of, study_aim
from oed.report.parts.reading import measured_as, nuisance_text, prior_of, readings_text
from oed.report.sections.candidates import candidates, comparison, criteria, paper
from oed.robots.sensors import Several
from oed.workflow.runner import record as record_of
from oed.workflow.studies import parse_study

FLAGSHIP = REPORTS / "choi_skid_steer"


class Compass(Sensor):
    """A sensor of the user's own."""

    kind: Literal["compass"] = "compass"

    @property
    def units(self) -> tuple[str, ...]:
        return ("rad",)

    def reading(self, moment: Moment) -> Expression:
        return moment.pose[2]

    def whitening(self, moment: Moment) -> Expression:
        return ca.SX(1 / math.radians(2))


@cache
def record(kind: str) -> Record:
    return sample_records.RECORDS[kind]()


def changed(kind: str, **study: object) -> Record:
    data = record(kind).data
    data["study"].update(study)
    return record_from(data)


class TestCriteria:
    @pytest.mark.slow
    def test_efficiencies_are_those_of_the_covariances(self):
        # Recomputed from the covariances predicted, relative to the nominal values.
        (table,) = criteria(record("sensors")).tables
        nominal = np.array([0.049, 0.049, 0.18])
        spreads = [
            np.array(one.covariances[0].covariance, dtype=float) / np.outer(nominal, nominal)
            for one in record("sensors").results
        ]
        largest = [np.linalg.eigvalsh(one)[-1] for one in spreads]
        volumes = [np.linalg.det(one) ** (1 / 3) for one in spreads]
        traces = [np.trace(one) for one in spreads]
        for title, sizes in (("E", largest), ("D", volumes), ("A", traces)):
            expected = [100 * min(sizes[:3]) / size for size in sizes]  # the last breaks limits
            assert column(table, f"{title}-efficiency") == pytest.approx(expected, rel=1e-6)

    def test_what_each_drive_was_searched_for_stands_beside_it(self):
        (table,) = criteria(record("sensors")).tables
        assert column(table, "searched for") == ["E", "D", None, None]
        assert column(table, "satisfies every limit") == [True, True, True, False]

    def test_drives_that_break_limits_are_no_measure(self):
        (table,) = criteria(record("sensors")).tables
        assert max(column(table, "D-efficiency")[:3]) == pytest.approx(100)
        assert column(table, "D-efficiency")[3] > 100

    def test_modified_e_is_shown_as_its_value(self):
        part = criteria(record("by_modified_E"))
        best = record("by_modified_E").results[0].criteria["modified_E"]
        assert column(part.tables[0], "modified E") == [best, -math.inf, -math.inf, -math.inf]
        assert "modified E is -cond(F)" in part.paragraphs[0]

    def test_the_paragraph_says_how_to_read_it(self):
        text = text_of(criteria(record("by_D")))
        assert "(det F/det F_best)^(1/p), p = 1" in text
        assert "has to be driven twice" in text
        assert "not one of repetitions" in text_of(criteria(record("sensors")))

    def test_a_best_without_the_largest_objective_is_explained(self):
        data = record("sensors").data
        data["results"][1].update(objective=1.002 * data["results"][0]["objective"])
        text = text_of(comparison(record_from(data)))
        assert "Design 2 is 0.20 % better by E than the designed drive, which counts as equal" in text

    def test_none_for_old_records_and_single_drives(self):
        assert criteria(sample_records.full()) is None
        alone = record("sensors").model_copy(update={"results": record("sensors").results[:1]})
        assert criteria(alone) is None


class TestCandidates:
    @pytest.mark.parametrize("kind", ["by_D", "by_A", "by_G", "by_I"])
    def test_repetitions_are_the_inverse_of_efficiency(self, kind: str):
        # k drives tell k times the information: every variance is divided by k.
        own = record(kind)
        size, value = study_aim(own).size, own.best.objective
        half = value - size * math.log(2) if kind == "by_D" else 2 * value
        assert repetitions_of(own, own.best.model_copy(update={"objective": half})) == pytest.approx(2)
        titles = [entry.title for entry in candidates(own).tables[0].columns]
        assert "repetitions for the same" in titles

    @pytest.mark.parametrize("kind", ["sensors", "by_modified_E"])
    def test_no_repetitions_where_they_are_not_proportional(self, kind: str):
        own = record(kind)
        table = candidates(own).tables[0]
        assert not repeatable(own)
        assert repetitions_of(own, own.results[1]) is None
        assert not {"efficiency", "repetitions for the same"} & {entry.title for entry in table.columns}
        assert "of them would be needed" not in text_of(section(record(kind), "Question and search"))

    def test_a_drive_that_tells_nothing_never_suffices(self):
        own = record("by_A")
        table = candidates(own).tables[0]
        assert column(table, "objective")[2] == -math.inf
        assert column(table, "repetitions for the same")[1:3] == [math.inf, math.inf]


class Logarithm(E):
    """A criterion of the user's own."""

    kind: Literal["logarithm"] = "logarithm"
    number: ClassVar[str] = "log λ_min"
    definition: ClassVar[str] = "the logarithm of the smallest eigenvalue"
    share: ClassVar[str] = ""
    asks_about: ClassVar[str] = ""
    proportional: ClassVar[bool] = False

    def judge(self, information: Sequence[SquareRoot]) -> np.ndarray:
        return np.log(super().judge(information))

    def efficiency(self, value: float, best: float, size: int) -> float | None:
        return math.exp(value - best)

    def deviation(self, value: float, size: int) -> str:
        return "the largest standard deviation is told"


class TestCriteriaOfTheUsersOwn:
    def test_one_describes_itself_on_the_page(self):
        parsed = parse_study(sample_records.SENSORS)
        own = Logarithm()
        study = replace(
            parsed,
            file=parsed.file.model_copy(update={"criterion": own}),
            problem=replace(parsed.problem, criterion=own),
        )
        drives = [
            sample_records.solution(study, name, *sample_records.SHAPES[name]) for name in ("arc", "ipopt")
        ]
        parts = {part.title: part for part in sections_of(record_of(study, drives, 7))}
        told = "The criterion is logarithm, the logarithm of the smallest eigenvalue, the parameters taken"
        assert told in text_of(parts["Question and search"])
        assert "the largest standard deviation is told" in text_of(parts["Question and search"])
        assert "logarithm-efficiency" in [one.title for one in parts["Criteria"].tables[0].columns]


class TestSearches:
    def test_they_are_grouped_by_what_they_searched_for(self):
        searches = [one for one in record("sensors").results if one.starts]
        groups = by_aim(record("sensors"), searches)
        assert [(aim.label, aim.size, len(entries)) for aim, entries in groups] == [("E", 3, 1), ("D", 3, 1)]

    def test_a_criterion_of_other_parameters_is_another(self):
        data = record("sensors").data
        data["study"]["solvers"][1]["criterion"] = {"kind": "E", "scaling": "none", "subset": ["track"]}
        data["results"][1]["criterion"] = "E"
        aim = aim_of(record_from(data), record_from(data).results[1])
        assert aim.label == "E of track with the parameters in SI units"
        assert aim.size == 1

    def test_starts_are_compared_in_efficiency(self):
        part = section(record("sensors"), "Spread over the starts")
        assert column(part.tables[0], "searched for") == ["E", "D"]
        assert column(part.tables[0], "within 1 %") == [1, 1]

    def test_stages_are_told_in_the_numbers_of_their_criterion(self):
        text = text_of(section(record("sensors"), "Spread over the starts"))
        assert "Stages of Design 2 (Arc), in D (log det F)" in text
        assert f"({100 * (math.exp(0.1 / 3) - 1):+.3g} % in efficiency)" in text
        assert "99.9 % of the determinant" in text

    def test_each_is_measured_by_the_best_of_its_own_criterion(self):
        part = section(record("sensors"), "Convergence")
        table = part.tables[0]
        assert column(table, "searched for") == ["E", "D"]
        assert column(table, "time to 90 %") == [0.5, 1.0]  # exp(-0.1) is just above 90 %
        assert column(table, "time to 99 %") == [0.5, 1.5]
        figure = drawn(part.figures[0].figure)
        assert "its own criterion" in figure.axes[0].get_ylabel()

    @pytest.mark.slow
    def test_one_criterion_needs_no_such_words(self):
        flagship = load_record(FLAGSHIP)
        parts = {part.title: part for part in sections_of(flagship)}
        assert "searched for" not in [one.title for one in parts["Convergence"].tables[0].columns]
        assert drawn(parts["Convergence"].figures[0].figure).axes[0].get_ylabel() == "below the best [%]"


class TestMeasured:
    def test_all_sensors_are_told(self):
        own = record("sensors")
        brief = "5 positions (x and y), the distances to 2 beacons at 21 times and 20 yaw rates"
        assert measured_as(own) == brief
        text = readings_text(own)
        assert (
            "x and y at every 5th sample (5 times) with a standard deviation of 10 mm per coordinate" in text
        )
        assert "growing with the speed V as √(σ² + (kV)²), k = 20 mm per m/s" in text
        assert "60 mm ahead of and 20 mm to the right of the robot's origin" in text
        assert "2 beacons at (-1, -1) m and (9, 1) m at every sample (21 times)" in text
        assert "the yaw rate in every period (20 times) with a standard deviation of 1 deg/s" in text

    def test_the_angle_of_a_trailer_is_told(self):
        angle = {"kind": "trailer_angle", "noise": math.radians(0.5), "bias": "unknown"}
        poses = {"kind": "poses", "noise": {"position": 0.01, "heading": 0.01}}
        own = changed("sensors", measurement={"kind": "several", "sensors": [poses, angle]})
        assert measured_as(own) == "21 poses (x, y and heading) and 21 trailer angles"
        told = "the trailer's angle at every sample (21 times) with a standard deviation of 0.5 deg."
        assert readings_text(own).endswith(told)

    def test_a_sensor_of_the_users_own_describes_itself_on_the_page(self):
        parsed = parse_study(sample_records.SENSORS)
        own = Several(sensors=(*parsed.file.measurement.sensors, Compass(every=4)))
        study = replace(
            parsed,
            file=parsed.file.model_copy(update={"measurement": own}),
            problem=replace(parsed.problem, measurement=own),
        )
        drives = [sample_records.solution(study, "arc", *sample_records.SHAPES["arc"])]
        made = record_of(study, drives, 7)
        assert measured_as(made).endswith(" and 6 readings of the compass")
        text = text_of(next(one for one in sections_of(made) if one.title.startswith("Predicted")))
        assert "the compass at every 4th sample (6 times) with a standard deviation of 2 deg" in text

    def test_old_records_are_told_by_the_study_that_they_hold(self):
        old = load_record(FLAGSHIP)
        assert measured_as(old) == "the displacements of 10 segments"
        assert measured_as(pickle.loads(pickle.dumps(old))) == "the displacements of 10 segments"

    def test_what_is_estimated_along_and_known_before(self):
        text = nuisance_text(record("sensors"))
        assert "the initial pose (prior: ± 50 mm and ± 2 deg)" in text
        assert "the lever arm of the poses (prior: ± 10 mm)" in text
        assert "and the bias of the yaw rate." in text
        assert prior_of(record("sensors")) == {"wheel_radius_left": "0.2 mm", "track": "10 %"}

    def test_an_unknown_map_is_in_the_frame_of_the_start(self):
        one = record("sensors").nuisances[0]
        names = [("initial_pose.x", 1e-3), ("landmarks.landmark_7.x", None), ("landmarks.landmark_8.y", None)]
        given = [one.model_copy(update={"name": name, "deviation": size}) for name, size in names]
        text = nuisance_text(record("sensors").model_copy(update={"nuisances": given}))
        assert text.endswith("the initial pose (the frame of the map) and the places of the landmarks.")

    def test_a_prior_covariance_is_told_by_its_deviations(self):
        prior = {"standard_deviations": {}, "parameters": ["track"], "covariance": [[4e-8]]}
        assert prior_of(changed("sensors", prior=prior)) == {"track": "0.20 mm"}

    @pytest.mark.parametrize(
        ("measurement", "told"),
        [
            (
                {"quantities": ["heading"], "noise": {"heading": math.radians(2)}, "every": 2},
                "heading at every 2nd sample (11 times) with a standard deviation of 2 deg in heading",
            ),
            (
                {"quantities": ["x", "y"], "noise": {"x": 0.01, "position": 0.02}},
                "standard deviations of 10 mm in x and 20 mm in y",
            ),
            (
                {"quantities": ["x", "y"], "noise": {"covariance": [[1e-4, 0], [0, 4e-4]]}},
                "given for one reading (standard deviations 10 mm in x and 20 mm in y)",
            ),
            (
                {
                    "quantities": ["x", "heading"],
                    "noise": {
                        "position": 0.01,
                        "heading": 0.01,
                        "position_per_speed": 0.02,
                        "heading_per_yaw_rate": 0.05,
                    },
                },
                "growing with the speed V and the yaw rate Ω as √(σ² + (kV)² + (k'Ω)²), "
                "k = 20 mm per m/s in position, k' = 2.865 deg per rad/s in heading",
            ),
        ],
    )
    def test_noise_in_words(self, measurement: dict[str, object], told: str):
        assert told in readings_text(changed("sensors", measurement={"kind": "poses", **measurement}))

    @pytest.mark.parametrize(
        ("estimator", "formula"), [("gls", "σ²(W'K⁻¹W)⁻¹"), ("ols", "σ²(W'W)⁻¹W'KW(W'W)⁻¹")]
    )
    @pytest.mark.slow
    def test_absolute_noise_has_its_own_formula(self, estimator: str, formula: str):
        own = record("absolute")
        measurement = {**own.data["study"]["measurement"], "estimator": estimator}
        parts = sections_of(changed("absolute", measurement=measurement))
        text = text_of(next(part for part in parts if part.title == "Predicted standard deviations"))
        assert formula in text
        assert "share the error of the pose between them" in text
        assert "which only F knows" in text_of(paper(own))


class TestSummary:
    def test_no_regressor_is_spoken_of(self):
        text = text_of(section(record("sensors"), "Question and search"))
        worst = 100 * record("sensors").results[0].lambda_min ** -0.5
        assert f"a standard deviation of {worst:.2f} % of nominal" in text
        assert "singular value" not in text
        assert "Prior, part of every number here: wheel radius left ± 0.2 mm" in text
        assert paper(record("sensors")) is None

    @pytest.mark.parametrize(
        ("kind", "told"),
        [
            ("by_D", "D, the logarithm of the information's determinant"),
            ("by_A", "root mean square of those of the parameters is"),
            ("by_modified_E", "modified E, minus the condition number of the information"),
            ("by_G", "the largest standard deviation of a predicted position is 15 mm"),
            ("by_I", "of a predicted heading is 2.4 deg"),
        ],
    )
    def test_every_criterion_in_words(self, kind: str, told: str):
        assert told in text_of(section(record(kind), "Question and search"))

    def test_parameters_that_are_not_judged_are_named(self):
        text = text_of(section(record("by_D"), "Question and search"))
        assert "is the most informative about track of this" in text
        assert "Wheel radius right and wheel radius left: estimated too, but not judged." in text

    @pytest.mark.slow
    def test_a_drive_on_the_spot_has_no_length(self):
        data = record("sensors").data
        entry = data["results"][0]
        entry["path_length"] = 2e-25
        entry["drive"]["poses"] = [[0.0, 0.0, 0.1 * index] for index in range(21)]
        parts = {part.title: part for part in sections_of(record_from(data))}
        assert "a drive in place (0.32 turns)" in text_of(parts["Question and search"])
        assert "in place" in drawn(parts["Paths in the workspace"].figures[0].figure).axes[0].get_title()


class TestPrecision:
    def test_deviations_are_readable_and_alike(self):
        by_parameter, _, all_drives = section(record("sensors"), "Predicted standard deviations").tables
        assert column(by_parameter, "unit") == ["mm", "mm", "mm"]
        known = record("sensors").results[0].standard_deviations
        assert column(by_parameter, "standard deviation") == pytest.approx(
            [1e3 * one for one in known.values()]
        )
        assert [entry.unit for entry in all_drives.columns[1:]] == ["mm", "mm", "mm"]

    def test_unlike_units_are_apart(self):
        table = section(record("absolute"), "Predicted standard deviations").tables[0]
        assert column(table, "unit") == ["1", "1", "mm", "mm"]

    def test_correlations_are_those_of_the_covariance(self):
        table = section(record("sensors"), "Predicted standard deviations").tables[1]
        covariance = np.array(record("sensors").results[0].covariances[0].covariance)
        sizes = np.sqrt(np.diag(covariance))
        found = np.array([row[1:] for row in table.rows], dtype=float)
        np.testing.assert_allclose(found, covariance / np.outer(sizes, sizes))
        assert (
            len(section(record("absolute"), "Predicted standard deviations").tables) == 4
        )  # one per regression


class TestValidation:
    def test_one_row_per_drive_estimator_and_parameter(self):
        part = section(record("absolute"), "Validation by simulation")
        table = part.tables[-1]
        assert column(table, "estimator") == [name for name in ("ols", "sandwich", "gls") for _ in range(4)]
        assert column(table, "± (paired)") == [1e-16] * 12
        assert table.cells[0][-2] == "0"
        (said,) = [one for one in part.paragraphs if one.startswith("ipopt by sandwich: ")]
        assert said.startswith("ipopt by sandwich: sandwich keeps its promise. The standard error of every")
        assert len(part.tables) == 4
        assert "in 3 ways: ols is ordinary least squares" in part.paragraphs[3]

    def test_sensors_know_no_headings(self):
        part = section(record("sensors"), "Validation by simulation")
        assert "true headings" not in part.paragraphs[1]
        assert (
            "nonlinear least squares from all readings together, along with the initial pose"
            in (part.paragraphs[1])
        )
        assert "A robust loss (soft l1)" in part.paragraphs[1]
        assert "estimator" not in [entry.title for entry in part.tables[-1].columns]

    def test_means_have_as_many_digits_as_tell_a_bias(self):
        table = section(record("sensors"), "Validation by simulation").tables[-1]
        assert column(table, "true")[0] == "49.000"
        assert column(table, "unit")[0] == "mm"

    def test_a_range_missed_by_chance_is_explained(self):
        table = section(record("sensors"), "Validation by simulation").tables[0]
        assert "a single one may well be outside its range" in table.caption

    def test_errors_are_drawn_where_estimates_are_all_alike(self):
        first, second = section(record("sensors"), "Validation by simulation").figures
        axes = drawn(first.figure).axes
        assert axes[-1].get_xlabel() == "error of wheel radius right [mm]"
        assert second.name == "estimates_wheel_radius_left_track"

    def test_a_prior_is_no_part_of_a_regression(self):
        own = record("absolute")
        with_prior = changed("absolute", prior={"standard_deviations": {"c21": "1 %"}})
        texts = [
            text_of(next(part for part in sections_of(one) if part.title == "Validation by simulation"))
            for one in (own, with_prior)
        ]
        assert ["takes no part in these estimates" in text for text in texts] == [False, True]


@pytest.mark.slow
def test_beacons_are_drawn_as_far_as_they_are_near():
    figure = drawn(section(record("sensors"), "Paths in the workspace").figures[0].figure)
    assert [entry.get_text() for entry in figure.legends[0].get_texts()][-1] == "beacon"
    low, high = figure.axes[0].get_xlim()
    assert low < -1 < high < 9


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
def test_sensors_compare_with_displacements(tmp_path: Path):
    named = [("first", record("sensors")), ("second", record("absolute")), ("third", record("by_D"))]
    write_comparison(named, tmp_path)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert r"| measurement.sensors.2.beacons | (-1, -1), (9, 1) | – | (-1, -1), (9, 1) |" in text
    assert r"| prior.standard\_deviations.track | 10 % | – | – |" in text
    found = text[text.index("## What the searches found") :]
    rows = [line.split(" | ") for line in found.splitlines() if line.startswith(("| first |", "| second |"))]
    assert rows[0][4:6] == ["–", "–"]  # no regressor
    assert "–" not in rows[1][4:6]


def test_a_study_that_nobody_understands_is_refused_by_its_key():
    with pytest.raises(RecordError, match=r"study\.measurement.*compass"):
        measured_as(changed("sensors", measurement={"kind": "compass"}))
