"""Studies of stiff and differential-algebraic systems, through YAML."""

from __future__ import annotations

import textwrap

import pytest

import oed
from oed.foundation.errors import StudyError
from oed.kernel.scorer import score
from oed.study.study import read_study
from oed.study.yaml_source import PlainSource

BUFFERED = textwrap.dedent("""\
    format: 1
    name: An exchange that is in equilibrium at once
    system:
      kind: equations
      states: {total: 2 mol/m^3}
      inputs: {feed: mol/m^3/s}
      parameters: {k: 0.1 1/s, K: 1 mol/m^3}
      derivatives: {total: feed - k * free}
      algebraic_states: {free: 1 mmol/l}
      algebraic: {free: free + free^2 / K - total}
      outputs: {read: free}
      integrator: radau
    experiment:
      duration: 60 s
      samples: 3
      inputs: {feed: [0 mol/m^3/s, 1 mol/m^3/s]}
    measurement: {kind: outputs, noise: {read: 0.01 mol/m^3}}
    criterion: D
    solvers: [{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}]
    """)


def test_algebraic_states_and_the_integrator_are_those_of_equations():
    system = oed.parse_study(BUFFERED).problem.model
    assert isinstance(system, oed.Equations)
    assert (system.integrator, system.substeps) == ("radau", 4)
    assert [(name, value, unit.text) for name, value, unit in system.guesses] == [("free", 1.0, "mol/m^3")]
    assert system.states == ("total",)


@pytest.mark.parametrize("changed", ["", "\n  substeps: 7"])
def test_a_study_written_out_is_itself_a_study(changed: str):
    study = oed.parse_study(BUFFERED.replace("integrator: radau", f"integrator: radau{changed}"))
    echo = read_study(PlainSource("echo", "", study.echo()))
    assert echo.problem.model == study.problem.model


@pytest.mark.parametrize(
    ("line", "instead", "key", "said"),
    [
        ("integrator: radau", "integrator: rado", "system.integrator", "radau"),
        ("integrator: radau", "integrator: runge_kutta", "system.integrator", "radau alone"),
        ("integrator: radau", "integrator: radau\n  substeps: 0", "system.substeps", "1"),
        ("free: 1 mmol/l", "free: 1 mmol/q", "system.algebraic_states.free", "mmol/q"),
        ("free + free^2 / K - total", "free + free^2 - total", "system.algebraic.free", "column 8"),
        ("free + free^2 / K - total", "total - K", "system.algebraic.free", "no algebraic state in it"),
        ("{free: free +", "{fre: free +", "system.algebraic.fre", "fre is no algebraic state"),
    ],
)
def test_mistakes_are_named_by_key_and_line(line: str, instead: str, key: str, said: str):
    assert line in BUFFERED
    with pytest.raises(StudyError) as error:
        oed.parse_study(BUFFERED.replace(line, instead))
    found = [issue for issue in error.value.issues if issue.key == key]
    assert any(said in issue.message for issue in found), error.value.issues
    assert all(issue.line for issue in found)


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
def test_its_design_is_as_good_with_finer_steps():
    study = oed.parse_study(BUFFERED)
    solution = oed.solve(study.problem, study.solvers[0], seed=0, workers=1)
    assert solution.status is oed.Status.CONVERGED
    finer = score(study.problem.refined(8), solution.trajectory)
    assert finer.objective == pytest.approx(solution.evaluation.objective, abs=1e-5)
