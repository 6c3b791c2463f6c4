"""What a console or a notebook shows of the package's own objects: a few lines, a small table, a figure."""

from __future__ import annotations

import inspect
import pydoc
import re
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import problem_of, random_drive
from report import sample_estimates, sample_records

import oed
from oed.foundation.text import words
from oed.kernel.solution import scored
from oed.records.outcomes import validation_of
from oed.records.record import EstimateRecord, Record
from oed.records.stored.simulation import StoredValidation
from oed.robots.baselines import baselines


@pytest.fixture(scope="module")
def record() -> Record:
    return sample_records.absolute()


@pytest.fixture(scope="module")
def estimate() -> EstimateRecord:
    return sample_estimates.read(sample_estimates.estimate())


@pytest.fixture(scope="module")
def driven(flagship):
    return scored(flagship, random_drive(flagship, 1, 3.0), "wave <b>")


@pytest.fixture(scope="module")
def noisy():
    problem = oed.load_study("problems/laser_tracker.yaml").problem
    return scored(problem, random_drive(problem, 1, 3.0), "wave")


@pytest.fixture
def frames(monkeypatch):
    fake = SimpleNamespace(DataFrame=lambda columns: SimpleNamespace(columns=columns, attrs={}))
    monkeypatch.setitem(sys.modules, "pandas", fake)


def shown(flagship, driven, record, estimate) -> dict[str, object]:
    times = np.arange(50.0)
    log = oed.Log("a", "a.csv", times, np.zeros((50, 2)), times, np.zeros((50, 3)))
    bound = oed.Certificate(9.0, "by hand", ("none",))
    return {
        "problem": flagship,
        "solution": driven,
        "trajectory": driven.trajectory,
        "evaluation": driven.evaluation,
        "record": record,
        "result": record.results[0],
        "estimate": estimate,
        "log": log,
        "certificate": bound,
    }


@pytest.mark.slow
def test_short_forms_are_a_few_lines(flagship, driven, record, estimate):
    for name, one in shown(flagship, driven, record, estimate).items():
        text = repr(one)
        assert text.lower().startswith(name), text
        assert len(text) < 900, name
        assert text.count("\n") <= 12, name
        # Of a record's results each has its line.
        assert ("\n" in text) == (name != "result")
        if name != "result":
            assert str(one) == text
            assert text in one.summary()


def test_a_study_and_its_keys_are_a_few_lines():
    study = oed.load_study("problems/laser_tracker.yaml")
    assert repr(study).startswith("Study Laser tracker\n")
    assert "E-optimal, D-optimal, A-optimal" in repr(study)
    assert len(repr(study.file)) < 250
    assert repr(study.file).startswith("StudyFile('Laser tracker', differential_drive; keys: ")


def test_notebooks_show_tables_in_which_everything_is_escaped(flagship, driven, record, estimate):
    for one in shown(flagship, driven, record, estimate).values():
        html = one._repr_html_()
        assert html.startswith("<div><strong>")
        assert "<b>" not in html
    assert "wave &lt;b&gt;" in driven._repr_html_()


def test_summaries_say_every_parameter_with_its_unit_and_error(record, estimate):
    text = record.summary()
    assert all(words(one.name) in text for one in record.parameters)
    assert " mm" in text
    text = estimate.summary()
    assert "standard error" in text
    assert all(words(one.name) in text for one in estimate.parameters)


def test_the_answer_comes_first(noisy, record, estimate):
    for one, names in (
        (noisy, noisy.evaluation.standard_deviations),
        (noisy.evaluation, noisy.evaluation.standard_deviations),
        (record, record.best.standard_deviations),
        (estimate, estimate.values),
    ):
        _, heads, *rows = repr(one).splitlines()
        assert heads.split()[0] == "parameter"
        assert heads.endswith("standard error")
        assert all(row.strip().startswith(words(name)) for row, name in zip(rows, names, strict=False))
        assert any(" mm " in row for row in rows)
        assert "</strong><table><thead>" in one._repr_html_()


def test_a_limit_that_is_exceeded_is_named_with_its_unit(flagship):
    text = repr(scored(flagship, random_drive(flagship, 1, 40.0), "fast"))
    assert re.search(r"wheel speed exceeded by \d+ rad/s;", text)


def test_a_validation_compares_the_errors(laser_validation):
    text = laser_validation.summary()
    assert text.startswith("Validation: ")
    assert "track" in text
    assert " mm" in text


@pytest.fixture(scope="module")
def laser_validation():
    units = ("m", "m")
    covariance = np.diag([1e-8, 4e-8])
    return oed.Validation(
        "gls", "known", 1000, 0, 0.01, ("wheel_radius", "track"), np.array([0.05, 0.18]),
        np.array([0.05, 0.18]), covariance, 1.1 * covariance, np.ones(2), np.ones(2), (), np.zeros((1, 2)),
        units,
    )  # fmt: skip


def test_tables_are_data_frames(driven, noisy, record, estimate, laser_validation, frames):
    table = record.to_dataframe()
    assert len(table.columns["name"]) == len(record.results)
    assert table.attrs["units"]["path_length"] == "m"
    assert {one.name for one in record.parameters} <= table.columns.keys()
    table = noisy.to_dataframe()
    assert dict(zip(table.columns["name"], table.columns["standard_error"], strict=True)) == (
        noisy.evaluation.standard_deviations
    )
    assert set(table.columns["unit"]) == {"m"}
    with pytest.raises(oed.UserMistake, match="there is no design to make a table of: The solver gave up"):
        replace(driven, evaluation=None, status=oed.Status.FAILED).to_dataframe()
    table = driven.trajectory.to_dataframe(("right", "left"))
    assert list(table.columns) == ["t", "right", "left"]
    assert table.columns["t"][1] == pytest.approx(driven.trajectory.period)
    assert np.array_equal(table.columns["left"], driven.trajectory.inputs[:, 1])
    assert list(driven.trajectory.to_dataframe().columns) == ["t", "input_1", "input_2"]
    with pytest.raises(ValueError, match="names: expected 2"):
        driven.trajectory.to_dataframe(("right",))
    assert estimate.to_dataframe().columns["value"] == list(estimate.values.values())
    assert laser_validation.to_dataframe().columns["ratio"] == pytest.approx(np.sqrt(1.1))


def test_stored_simulations_are_a_data_frame_as_fresh_ones_are(laser_validation, frames):
    stored = StoredValidation.of(
        results=[validation_of(name, laser_validation) for name in ("ipopt", "square")]
    )
    table, fresh = stored.to_dataframe().columns, laser_validation.columns
    assert list(table["name"]) == ["ipopt", "ipopt", "square", "square"]
    for name, column in fresh.items():
        assert list(table[name]) == [*column, *column]


def test_a_log_gives_a_table_of_each_clock(frames):
    log = oed.Log("a", "a.csv", np.arange(4.0), np.ones((4, 2)), np.arange(3.0), np.zeros((3, 3)))
    assert list(log.to_dataframe().columns) == ["t", "x", "y", "heading"]
    assert len(log.to_dataframe("inputs").columns["integral_2"]) == 4
    with pytest.raises(ValueError, match="expected poses or inputs"):
        log.to_dataframe("both")


@pytest.mark.slow
def test_figures_are_matplotlibs(flagship, driven, record, estimate):
    for figure in (driven.plot(), driven.plot("inputs"), record.plot("paths"), estimate.plot()):
        assert figure.axes
    assert driven.plot()._repr_png_().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_solution_is_drawn_in_its_room():
    problem = problem_of()
    search = oed.Ipopt(starts=1, perturbations=0, second_stage="none", max_iterations=3)
    found = oed.solve(problem, search, workers=1)
    (baseline, *_) = baselines(problem, "square")
    own = replace(found, problem=None)
    assert own == found
    for one in (found, baseline):
        assert one.problem is problem
        shown = [patch.get_extents() for patch in one.plot().axes[0].patches]
        assert len(shown) > len(own.plot().axes[0].patches)


@pytest.mark.parametrize(("one", "other"), [("path", "best_path"), ("inputs", "wheel_speeds")])
@pytest.mark.slow
def test_figures_have_the_same_names_everywhere(one, other, driven, record):
    for subject in (driven, record):
        pair = [subject.plot(name).axes[0].get_lines() for name in (one, other)]
        data = [[line.get_xydata().tolist() for line in lines] for lines in pair]
        assert data[0] == data[1] != []


def test_a_figure_that_there_is_not_is_refused_with_those_that_there_are(driven, record):
    with pytest.raises(oed.UserMistake, match="expected one of path and inputs; there is no figure 'room'"):
        driven.plot("room")
    with pytest.raises(oed.UserMistake, match=r"no figure 'wheel_sped'; did you mean wheel_speeds\?"):
        record.plot("wheel_sped")
    with pytest.raises(oed.UserMistake, match=r"no figure 'imputs'; did you mean inputs\?"):
        driven.plot("imputs")
    with pytest.raises(oed.UserMistake, match=r"paths.*there is no figure 'room'"):
        record.plot("room")
    nothing = oed.Solution("ipopt", "ipopt", None, None, oed.Status.INFEASIBLE)
    with pytest.raises(oed.UserMistake, match="no design to draw"):
        nothing.plot()


@pytest.mark.slow
def test_an_import_of_the_package_alone_is_enough_to_draw():
    code = (
        "import sys, oed\n"
        "assert not {'matplotlib', 'oed.report', 'inspect'} & sys.modules.keys()\n"
        "import oed.report\n"
        "record = oed.load_record(sys.argv[1])\n"
        "assert 'matplotlib' not in sys.modules\n"
        "print(type(record.plot()).__mro__[1].__module__)\n"
    )
    folder = f"{oed.__path__[0]}/../reports/gallery/choi_skid_steer"
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, folder], capture_output=True, text=True, check=True
    )
    assert run.stdout == "matplotlib.figure\n"


def test_the_package_says_its_version_and_what_to_begin_with():
    assert oed.__version__[0].isdigit()
    assert all(f"oed.{one}(" in oed.__doc__ for one in ("load_study", "solve", "run", "export", "estimate"))
    assert all(not one.startswith("_") for one in dir(oed))


def test_the_package_lists_every_name_once():
    _, listed = oed.__doc__.split("all names")
    names = [
        name for line in re.findall(r"^ {8}(.*)", listed, flags=re.MULTILINE) for name in line.split(", ")
    ]
    assert sorted(name.rstrip(",") for name in names) == dir(oed)


def helped(thing: object) -> str:
    return pydoc.plain(pydoc.render_doc(thing))


@pytest.mark.slow
def test_help_fits_on_some_screens():
    assert len(helped(oed)) < 32_000
    for name in dir(oed):
        text = helped(getattr(oed, name))
        assert len(text) < 15_000, name
        assert not re.search(r"model_dump|model_config|__pydantic|inherited from pydantic", text), name


@pytest.mark.parametrize("used", [False, True])
def test_signatures_are_the_fields(used: bool):
    if used:
        oed.Ipopt()
    given = inspect.signature(oed.Ipopt).parameters
    assert list(given) == [name for name in oed.Ipopt.model_fields if name != "kind"]
    assert given["starts"].default == oed.Ipopt().starts
    assert len(str(inspect.signature(oed.Ipopt))) < 400
    assert inspect.signature(oed.DifferentialDrive).parameters["track"].default is inspect.Parameter.empty
    assert "criterion: 'Criterion | str'" in str(inspect.signature(oed.Problem))
