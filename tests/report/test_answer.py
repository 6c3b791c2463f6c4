"""The answer: what terminal and page say first, and that it never flatters the design."""

from __future__ import annotations

import json
from typing import Any

import pytest
import sample_records
from places import REPORTS
from recorded import record_from

from oed.cli.terminal.console import print_answer
from oed.foundation.text import words
from oed.records.record import Record, load_record
from oed.report.answer import answer_of, best_baseline
from oed.report.page import write_report

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


@EVERY
def test_no_headline_names_a_baseline_worse_than_the_best_that_can_be_driven(make: Any):
    record = make()
    answer, best = answer_of(record), best_baseline(record)
    assert answer is not None
    for one in baselines_of(record):
        assert best.worth >= one.worth
    if answer.baseline:
        assert answer.baseline == words(best.name)
        said = " ".join(answer.sentences)
        others = {words(one.name) for one in record.results if one.origin == "baseline"} - {answer.baseline}
        assert not any(f"baseline, {name}," in said for name in others)


@EVERY
def test_a_row_for_each_parameter_in_its_unit(make: Any):
    record = make()
    for row, parameter in zip(answer_of(record).rows, record.parameters, strict=False):
        assert row.name == words(parameter.name)
        assert row.designed


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
    record = changed()
    weak = best_baseline(record)
    errors = {name: 50 * size for name, size in record.best.standard_deviations.items()}
    weak = weak.model_copy(update={"objective": record.best.objective / 2500, "standard_deviations": errors})
    answer = answer_of(record.model_copy(update={"results": [record.best, weak]}))
    assert answer.sentences[0] == (
        f"Standard errors are those of the best baseline, {words(weak.name)}, divided by 50."
    )


def test_baselines_that_cannot_be_driven_say_why():
    record = changed()
    results = [one for one in record.results if not one.feasible or one.name == record.best.name]
    results = [
        one.model_copy(update={"name": one.name.removesuffix("_same_length")}) if not one.feasible else one
        for one in results
    ]
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


def test_nothing_that_can_be_driven_is_no_answer():
    assert answer_of(sample_records.without_drive()) is None


def test_without_noise_the_key_to_add_is_named():
    answer = answer_of(sample_records.full(noise="{}"))
    assert answer.rows == ()
    assert "give `noise`" in answer.sentences[0]


@pytest.mark.parametrize(
    ("gap", "said"),
    [
        (0.0, "No drive can be better (proved)."),
        (0.13, "No drive can be better by more than 13 % (proved)."),
        (3.3, "No drive can be better by more than a factor of 4.3 (proved)."),
    ],
)
def test_what_is_proved(gap: float, said: str):
    record = changed()
    bound = record.best.objective * (1 + gap)
    certificate = record.certificate.model_copy(update={"gap": gap, "gap_to": bound, "upper_bound": bound})
    assert said in answer_of(record.model_copy(update={"certificate": certificate})).sentences
