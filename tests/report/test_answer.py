"""The answer: what terminal and page say first, and that it never flatters the design."""

from __future__ import annotations

import html
import json
from typing import Any

import numpy as np
import pytest
import sample_records
from places import REPORTS
from recorded import exceeding, record_from

from oed.cli.terminal.console import print_answer
from oed.foundation.text import words
from oed.kernel.criteria import A, D, E
from oed.records.record import Record, load_record
from oed.report.answer import answer_of, best_baseline, title_of
from oed.report.page import write_report
from oed.report.parts.judging import judged
from oed.report.refusal import refusal_of

pytestmark = pytest.mark.usefixtures("blank_figures")

SAVED = {path.parent.name: path.parent for path in REPORTS.rglob("record.json")}
SAMPLES = {
    "full": sample_records.full,
    "single": sample_records.single,
    "many": sample_records.many,
    "sensors": sample_records.sensors,
    "absolute": sample_records.absolute,
    "by D": lambda: sample_records.by_criterion("{kind: D}"),
    **{
        path.parent.name: (lambda folder=path.parent: load_record(folder))
        for path in REPORTS.rglob("record.json")
    },
}
EVERY = pytest.mark.parametrize("make", SAMPLES.values(), ids=SAMPLES.keys())


def changed(**parts: Any) -> Record:
    """The committed flagship record with other parts."""
    data = json.loads(next(REPORTS.rglob("choi_skid_steer/record.json")).read_text())
    return record_from({**data, **parts})


def baselines_of(record: Record) -> list[Any]:
    return [one for one in record.results if one.origin == "baseline" and one.feasible and not one.useless]


def identified_by(record: Record, one: Any) -> int:
    """How many parameters a drive identifies, with an error below their size."""
    sizes = [(one.standard_deviations.get(each.name), abs(each.nominal)) for each in judged(record)]
    return sum(error is not None and (not size or error <= size) for error, size in sizes)


def beside(errors: dict[str, float | None], share: float, **parts: Any) -> Record:
    """The flagship with one baseline: its errors in the design's, its objective in the design's."""
    record = changed()
    weak, best = best_baseline(record), record.best
    own = {
        name: None if times is None else times * best.standard_deviations[name]
        for name, times in errors.items()
    }
    weak = weak.model_copy(update={"objective": share * best.objective, "standard_deviations": own, **parts})
    return record.model_copy(update={"results": [best, weak]})


@pytest.mark.slow
@EVERY
def test_no_headline_names_a_baseline_worse_than_the_best_that_can_be_driven(make: Any):
    record = make()
    answer, best = answer_of(record), best_baseline(record)
    assert answer is not None
    identified = {one.name: identified_by(record, one) for one in baselines_of(record)}
    for one in baselines_of(record):
        assert identified[best.name] >= identified[one.name]
        if identified[one.name] == len(judged(record)):
            assert best.worth >= one.worth
    if answer.baseline:
        assert answer.baseline == words(best.name.removesuffix("_same_length"))
        said = " ".join(answer.sentences)
        others = {words(one.name) for one in record.results if one.origin == "baseline"} - {answer.baseline}
        assert not any(f"baseline, {name}," in said for name in others)


@EVERY
def test_a_row_for_each_parameter_in_its_unit(make: Any):
    record = make()
    rows = answer_of(record).rows
    if rows:
        assert sorted(row.name for row in rows) == sorted(words(one.name) for one in record.parameters)
    assert all(row.designed for row in rows)


@pytest.mark.slow
def test_it_is_the_same_on_page_and_terminal(tmp_path, capsys):
    record = changed()
    answer = answer_of(record)
    print_answer(answer)
    printed = capsys.readouterr().out
    page = write_report(record, tmp_path).with_suffix(".md").read_text()
    for sentence in answer.sentences:
        assert sentence in " ".join(printed.split())
        assert sentence.split(" (")[0] in page
    for row in answer.rows:
        for text in (row.value, row.designed, row.baseline):
            assert text in printed
            assert text in page
    lines = printed.splitlines()
    assert len(lines) <= 16
    assert max(map(len, lines)) <= 80


def test_the_title_says_a_round_rooms_radius():
    study = changed().data["study"]
    study["limits"]["workspace"] = {"kind": "circle", "radius": 2.0}
    assert title_of(changed(study=study)).endswith("a drive of 20 s in a round room of radius 2 m")


def test_a_baseline_that_leaves_something_open_is_no_number():
    record = changed()
    weak = [
        one.model_copy(update={"identifiable": False, "standard_deviations": {"c21": None, "c22": 0.01}})
        for one in record.results
        if one.name == "straight"
    ]
    record = record.model_copy(update={"results": [record.best, *weak]})
    answer = answer_of(record)
    assert answer.sentences[0] == (
        "From no usual drive are all parameters identifiable: from the best, straight, c21 is not."
    )
    assert [row.baseline for row in answer.rows] == ["not identifiable", "10 mm"]


def test_thousands_of_drives_are_no_comparison():
    # Of errors a hundredth of the parameters' size, so that fifty times as large ones still say something.
    record = beside({"c21": 50, "c22": 50}, 1 / 2500)
    for one in record.results:
        smaller = {name: size / 100 for name, size in one.standard_deviations.items()}
        one.standard_deviations.update(smaller)
    assert answer_of(record).sentences[0] == (
        "Standard errors are those of the best baseline, figure eight, divided by 50."
    )


@pytest.mark.parametrize(
    ("errors", "share", "said"),
    [
        ((2, 2), 0.25, "As good as 4.0 drives of the best baseline, figure eight."),
        ((2, 3), 0.25, "As good as 4.0 to 9.0 drives of the best baseline, figure eight."),
        (
            (2, 0.8),
            0.25,
            "The best baseline, figure eight, is more precise about c22; "
            "to be as precise in every parameter takes 4.0 drives of it.",
        ),
        (
            (2, 1),
            0.25,
            "The best baseline, figure eight, is as precise about c22; "
            "to be as precise in every parameter takes 4.0 drives of it.",
        ),
        (
            (0.9, 0.8),
            0.25,
            "No parameter by itself is more precise than from the best baseline, figure eight; "
            "the standard error of the least certain combination of parameters is 2.0 times smaller.",
        ),
        ((1, 1), 1.0, "As good as the best baseline, figure eight."),
        (
            (0.9, 1),
            1.0,
            "The best baseline, figure eight, is more precise about c21, and as good by the standard error "
            "of the least certain combination of parameters.",
        ),
    ],
)
def test_repetitions_are_those_that_every_error_in_sight_bears_out(
    errors: tuple[float, float], share: float, said: str
):
    record = beside(dict(zip(("c21", "c22"), errors, strict=True)), share)
    assert answer_of(record).sentences[0] == said


@pytest.mark.parametrize(
    ("errors", "order"),
    [
        ((2, 3), ["c21", "c22"]),
        ((2, 0.8), ["c22", "c21"]),
        ((2, 1.02), ["c22", "c21"]),
        ((0.8, 0.9), ["c21", "c22"]),
        ((None, 1), ["c22", "c21"]),
        ((2, None), ["c21", "c22"]),
    ],
)
def test_rows_begin_with_parameters_that_the_design_does_not_improve(
    errors: tuple[float | None, float | None], order: list[str]
):
    record = beside(dict(zip(("c21", "c22"), errors, strict=True)), 0.25)
    assert [row.name for row in answer_of(record).rows] == order


def test_a_parameter_that_is_not_judged_is_among_those_that_the_design_does_not_improve():
    record = beside({"c21": 2, "c22": 0.5}, 0.25)
    first, last = record.parameters
    aside = record.model_copy(update={"parameters": [first, last.model_copy(update={"judged": False})]})
    answer = answer_of(aside)
    assert [row.name for row in answer.rows] == ["c22", "c21"]
    assert "more precise about c22" in answer.sentences[0]


@pytest.mark.slow
def test_standard_errors_with_usual_drift_are_a_line_in_the_order_of_the_rows(tmp_path, capsys):
    record = beside({"c21": 2, "c22": 0.8}, 0.25)
    best = record.best.model_copy(update={"usual_drift_deviations": {"c21": 5e-3, "c22": None}})
    drifting = record.model_copy(update={"results": [best, *record.results[1:]]})
    line = "With usual drift the standard errors would be not identifiable, 5.0 mm."
    assert line in answer_of(drifting).sentences
    print_answer(answer_of(drifting))
    assert line in " ".join(capsys.readouterr().out.split())
    page = write_report(drifting, tmp_path)
    assert line in page.with_suffix(".md").read_text()
    assert line in html.unescape(page.read_text()).replace("\N{NO-BREAK SPACE}", " ")
    (stored, *_) = drifting.plain()["results"]
    assert stored["usual_drift_deviations"] == {"c21": 5e-3, "c22": None}


def test_records_without_usual_drift_say_nothing_of_it():
    data = changed().data
    for result in data["results"]:
        result.pop("usual_drift_deviations", None)
    answer = answer_of(record_from(data))
    assert not any("drift" in sentence for sentence in answer.sentences)


def test_an_error_beyond_a_parameters_size_tells_nothing_of_it():
    record = beside({"c21": 2, "c22": 6}, 1 / 36)
    assert 6 * record.best.standard_deviations["c22"] > record.parameters[1].nominal
    answer = answer_of(record)
    assert [row.baseline for row in answer.rows] == ["9.4 mm", "cannot tell"]
    assert answer.sentences[0] == (
        "From no usual drive are all parameters identifiable: from the best, figure eight, c22 is not."
    )


def test_a_baseline_that_tells_every_parameter_comes_before_one_that_does_not():
    record = beside({"c21": 2, "c22": 6}, 0.9)
    square = next(one for one in changed().results if one.name == "square")
    record = record.model_copy(update={"results": [*record.results, square]})
    assert record.results[1].worth > square.worth
    assert best_baseline(record).name == "square"


def test_where_no_baseline_tells_all_the_most_precise_about_the_rest_is_named():
    record = beside({"c21": 2, "c22": 6}, 0.1)
    finer = record.results[1].model_copy(
        update={
            "name": "circle",
            "objective": 0.0,
            "identifiable": False,
            "standard_deviations": {"c21": 1e-3, "c22": None},
        }
    )
    record = record.model_copy(update={"results": [*record.results, finer]})
    assert best_baseline(record).name == "circle"


def test_baselines_that_cannot_be_driven_say_why():
    record = changed()
    results = [record.best, exceeding(record.result("square"), wheel_speed=0.3, wheel_acceleration=2)]
    answer = answer_of(record.model_copy(update={"results": results}))
    assert answer.baseline == ""
    assert answer.sentences[0].startswith("No baseline can be driven here: square exceeds wheel speed")


def test_a_better_baseline_is_said_to_be_better():
    record = changed()
    best = best_baseline(record).model_copy(update={"objective": 2 * record.best.objective})
    results = [best if one.name == best.name else one for one in record.results]
    answer = answer_of(record.model_copy(update={"results": results, "named": "ipopt"}))
    assert "is better: drive that" in answer.sentences[0]


def test_failed_simulations_are_said():
    record = changed()
    own = next(one for one in record.validation.results if one.name == record.best.name)
    check = own.checks[0].model_copy(update={"passed": False})
    own = own.model_copy(update={"checks": [check, *own.checks[1:]]})
    found = record.validation.model_copy(update={"results": [own]})
    said = answer_of(record.with_validation(found)).sentences[-1]
    assert "errors are not as predicted" in said
    assert check.question in said


@pytest.mark.parametrize(
    ("replicates", "said"), [(10_000, "to within 2.2 %"), (100, "to within 14 %"), (2, "as far as")]
)
def test_passed_simulations_say_how_far_they_tell(replicates: int, said: str):
    # It follows from the covariances and the number of experiments, whatever the saved verdict says.
    record = changed()
    (saved,) = [result for result in record.validation.results if result.name == record.best.name]
    own = saved.model_copy(update={"verdict": "saved by an older version"})
    found = record.validation.model_copy(update={"replicates": replicates, "results": [own]})
    record = record.with_validation(found)
    assert f"times: errors as predicted, {said}" in answer_of(record).sentences[-1]
    assert said in found.verdict(own)


@pytest.mark.slow
def test_of_several_estimators_the_one_that_says_least_counts():
    record = sample_records.absolute()
    own = [one for one in record.validation.results if one.name == record.best.name]
    assert len(own) > 1
    sampled = [[4.0 * value for value in row] for row in own[0].sampled_covariance]
    worse = own[0].model_copy(update={"sampled_covariance": sampled})
    found = record.validation.model_copy(update={"results": [*own[1:], worse]})
    assert "to within a factor of 2." in answer_of(record.with_validation(found)).sentences[-1]


@pytest.mark.slow
def test_nothing_that_can_be_driven_is_no_answer_but_reasons():
    record = sample_records.without_drive()
    assert answer_of(record) is None
    said = refusal_of(record)
    assert said[1] == "No drive was found that satisfies every limit."
    assert said[2] == record.results[0].message
    assert answer_of(sample_records.full()) is not None


def test_the_usual_drive_that_comes_closest_is_named_with_what_it_exceeds():
    record = changed()
    results = [
        exceeding(record.result("square"), wheel_speed=0.1, wheel_acceleration=0.2),
        exceeding(record.result("figure_eight"), workspace=0.4),
        exceeding(record.result("random"), wheel_speed=0.1, workspace=0.1),
    ]
    said = refusal_of(record.model_copy(update={"results": results, "named": None}))[-1]
    assert "Of the usual drives figure eight comes closest" in said
    assert "workspace by" in said
    assert "wheel" not in said
    assert "_" not in said


def test_without_noise_the_key_to_add_is_named():
    answer = answer_of(sample_records.full(noise="{}"))
    assert answer.rows == ()
    assert "give `noise`" in answer.sentences[0]


@pytest.mark.parametrize(
    ("gap", "said"),
    [
        (0.0, " (proved)."),
        (0.21, " by more than 9.1 % (proved)."),
        (3.41, " by more than a factor of 2.1 (proved)."),
    ],
)
def test_what_is_proved_is_said_of_the_standard_errors_in_sight(gap: float, said: str):
    record = changed()
    bound = record.best.objective * (1 + gap)
    certificate = record.certificate.model_copy(update={"gap": gap, "gap_to": bound, "upper_bound": bound})
    what = "the standard error of the least certain combination of parameters"
    answer = answer_of(record.model_copy(update={"certificate": certificate}))
    assert f"No drive can make {what} smaller{said}" in answer.sentences


def test_what_a_bound_leaves_out_is_said_beside_it():
    record = changed()
    bound = record.best.objective * 1.21
    assumptions = ["exact arcs", "the room is left out"]
    parts = {"gap": 0.21, "gap_to": bound, "upper_bound": bound, "assumptions": assumptions}
    certificate = record.certificate.model_copy(update=parts)
    said = answer_of(record.model_copy(update={"certificate": certificate})).sentences[1]
    assert said.endswith("(proved; the room is left out, so less may be possible).")


@pytest.mark.parametrize(
    ("criterion", "size", "errors"),
    [
        (E(), 3, lambda matrix: np.linalg.eigvalsh(np.linalg.inv(matrix))[-1] ** 0.5),
        (D(), 3, lambda matrix: np.exp(np.log(np.linalg.eigvalsh(np.linalg.inv(matrix))).mean() / 2)),
        (A(), 3, lambda matrix: np.trace(np.linalg.inv(matrix)) ** 0.5),
    ],
    ids=["E", "D", "A"],
)
def test_criteria_are_about_the_standard_error_that_they_name(criterion: Any, size: int, errors: Any):
    rng = np.random.default_rng(3)
    one, other = (root @ root.T for root in rng.normal(size=(2, size, 2 * size)))
    share = criterion.efficiency(float(criterion.value([one])), float(criterion.value([other])), size)
    assert share**-0.5 == pytest.approx(errors(one) / errors(other))
    assert "standard error" in criterion.standard_error(["a", "b", "c"])
    assert criterion.standard_error(["a"]) == "the standard error of a"


def test_a_criterion_of_no_standard_error_is_named():
    data = json.loads(next(REPORTS.rglob("choi_skid_steer/record.json")).read_text())
    data["study"]["criterion"]["kind"] = "modified_E"
    said = answer_of(record_from(data)).sentences
    assert any(one.startswith("No drive can be better by the criterion modified E") for one in said)


def test_how_many_readings_are_taken_is_said_of_a_robot():
    data = sample_records.single().data
    sizes = {"sensor": "poses", "run": 0, "size": 1.0, "relaxed": 1.0, "derivative": 1.0}
    readings = [{**sizes, "time": float(place), "weight": float(place < 2)} for place in range(5)]
    budget = {"readings": [0, 1, 2, 3, 4], "total": 2.0, "most": 1.0}
    numbers = {"value": 1.0, "relaxed": 1.0, "bound": 1.0, "efficiency": 1.0}
    data["results"][0]["selection"] = {"whole": True, "budgets": [budget], "readings": readings, **numbers}
    answer = answer_of(record_from(data))
    assert answer is not None
    assert answer.sentences[0] == "Taken are 2 of 5 possible readings."
