"""Systems of the user's own, by their classes: as good as the same equations as texts."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

import oed
from oed.foundation.errors import RecordError, StudyError

CODE = textwrap.dedent("""\
    import casadi as ca
    import oed


    class Decay(oed.ContinuousSystem):
        kind: str = "decay"
        rate: float = 0.5
        states = ("a", "b")
        state_units = ("mol/m^3", "mol/m^3")
        inputs = (oed.Input("feed", "feed", "mol/m^3/s"),)
        output_units = {"b": "mol/m^3"}

        @property
        def parameters(self):
            return (oed.Parameter("k", self.rate, "1/s"), oed.Parameter("l", 0.2, "1/s"))

        def derivative(self, state, inputs, parameters):
            k, l = parameters[0], parameters[1]
            return ca.vertcat(inputs[0] - k * state[0], k * state[0] - l * state[1])

        def outputs(self, state, inputs, parameters):
            return {"b": state[1]}
    """)
SHARED = textwrap.dedent("""\
    experiment:
      duration: 10 s
      samples: 20
      inputs: {feed: {range: [0 mol/m^3/s, 1 mol/m^3/s], signal: {kind: piecewise_constant, pieces: 4}}}
    measurement: {kind: outputs, noise: {b: 0.01 mol/m^3}}
    solvers: [{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}]
    """)
BY_CLASS = textwrap.dedent("""\
    format: 1
    name: A decay in two steps
    system:
      kind: python
      object: decay:Decay
      rate: 0.7
      start: {a: 1 mol/m^3, b: {design: [0 mol/m^3, 1 mol/m^3]}}
    """)
BY_TEXT = textwrap.dedent("""\
    format: 1
    name: A decay in two steps
    system:
      kind: equations
      states: {a: 1 mol/m^3, b: {design: [0 mol/m^3, 1 mol/m^3]}}
      inputs: {feed: mol/m^3/s}
      parameters: {k: 0.7 1/s, l: 0.2 1/s}
      derivatives: {a: feed - k * a, b: k * a - l * b}
      outputs: {b: b}
    """)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With the class, and a study that names it."""
    (tmp_path / "decay.py").write_text(CODE)
    (tmp_path / "study.yaml").write_text(BY_CLASS + SHARED)
    (tmp_path / "texts.yaml").write_text(BY_TEXT + SHARED)
    return tmp_path


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
def test_it_is_the_same_system_as_its_equations(folder: Path):
    one, other = (oed.load_study(folder / name) for name in ("study.yaml", "texts.yaml"))
    # A few steps lead to the same place only where all derivatives are the same.
    solver = one.solvers[0].model_copy(update={"max_iterations": 5})
    found = [oed.solve(study.problem, solver, seed=0) for study in (one, other)]
    assert found[0].evaluation.objective == pytest.approx(found[1].evaluation.objective, rel=1e-9)
    np.testing.assert_allclose(found[0].trajectory.inputs, found[1].trajectory.inputs, atol=1e-6)
    assert 0 <= found[0].trajectory.start[1] <= 1


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures", "few_screened")
def test_a_record_of_it_runs_no_code_until_it_is_trusted(folder: Path):
    study = oed.load_study(folder / "study.yaml")
    oed.run(study, folder / "out")
    saved = oed.load_record(folder / "out")
    oed.write_report(saved, folder / "out")
    page = (folder / "out" / "report.md").read_text()
    assert "A decay in two steps" in page
    assert "robot" not in page.lower()
    with pytest.raises(RecordError, match="decay:Decay is code"):
        oed.records.recorded_study.recorded_study(saved)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("b: {design: [0 mol/m^3, 1 mol/m^3]}", "c: 0", "missing: how b begins"),
        ("a: 1 mol/m^3", "a: 1 m", "expected a value in mol/m^3"),
        ("decay:Decay", "decay:Delay", "Delay"),
        ("rate: 0.7", "rote: 0.7", "rote"),
    ],
)
def test_mistakes_are_named(folder: Path, old: str, new: str, said: str):
    (folder / "study.yaml").write_text((BY_CLASS + SHARED).replace(old, new))
    with pytest.raises(StudyError, match=re.escape(said)):
        oed.load_study(folder / "study.yaml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('state_units = ("mol/m^3", "mol/m^3")', 'state_units = ("mol/m^3",)', "state_units: expected 2"),
        ('return {"b": state[1]}', 'return {"c": state[1]}', "expected those of output_units"),
        ("return ca.vertcat(inputs[0]", "return ca.vertcat(1, inputs[0]", "cannot be made"),
        ('output_units = {"b": "mol/m^3"}', 'output_units = {"b": "mool"}', "mool"),
    ],
)
def test_classes_that_do_not_fit_are_refused(folder: Path, old: str, new: str, said: str):
    (folder / "decay.py").write_text(CODE.replace(old, new))
    with pytest.raises(StudyError, match=re.escape(said)):
        oed.load_study(folder / "study.yaml")
