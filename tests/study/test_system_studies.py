"""Studies of systems given by equations, through YAML."""

from __future__ import annotations

import textwrap

import numpy as np
import pytest

import oed
from oed.foundation.errors import StudyError
from oed.kernel.identifiability import require_identifiable

POINTS = textwrap.dedent("""\
    format: 1
    name: Two reactions
    system:
      kind: equations
      inputs: {t: s}
      parameters: {k1: 0.7 1/min, k2: 0.2 1/min}
      outputs: {b: k1 / (k1 - k2) * (exp(-k2 * t) - exp(-k1 * t))}
    experiment:
      points: 2
      inputs: {t: [0 min, 20 min]}
    measurement: {kind: responses, noise: {b: 0.05}}
    criterion: {kind: D, scaling: none}
    solvers: [{kind: ipopt, starts: 2}]
    """)
TANK = textwrap.dedent("""\
    format: 1
    name: A tank that cools
    system:
      kind: equations
      states: {temperature: 350 K}
      inputs: {heat: W}
      parameters: {loss: 2 W/K, capacity: 4 kJ/K}
      derivatives: {temperature: (heat - loss * (temperature - 293 * unit)) / capacity}
      define: {unit: heat / heat * capacity / capacity}
      outputs: {read: temperature}
    experiment:
      duration: 1 h
      samples: 60
      inputs: {heat: {range: [0 W, 500 W], rate: 20 W/min}}
    measurement: {kind: outputs, noise: {read: 0.5 K}}
    solvers: [{kind: ipopt, starts: 2}]
    """)


def of(text: str, **changes: str) -> str:
    """A study with lines, known by how they begin, changed."""
    for begin, line in changes.items():
        found = [one for one in text.splitlines() if one.strip().startswith(begin)]
        assert len(found) == 1
        indent = found[0][: len(found[0]) - len(found[0].lstrip())]
        text = text.replace(found[0], indent + line)
    return text


@pytest.mark.parametrize(
    ("text", "change", "key"),
    [
        (POINTS, {"parameters": "parameters: {k1: true, k2: 0.2 1/min}"}, "system.parameters.k1"),
        (POINTS, {"parameters": "parameters: {k1: 0.7 1/min, k2: false}"}, "system.parameters.k2"),
        (POINTS, {"inputs: {t: [0": "inputs: {t: [false, 20 min]}"}, "experiment.inputs.t.0"),
        (POINTS, {"inputs: {t: [0": "inputs: {t: true}"}, "experiment.inputs.t"),
        (POINTS, {"measurement": "measurement: {kind: responses, noise: {b: true}}"}, "measurement.noise.b"),
        (POINTS, {"criterion": "criterion: {kind: D, scaling: {k1: true, k2: 1}}"}, "criterion.scaling.k1"),
        (POINTS, {"criterion": "prior: {standard_deviations: {k1: true}}"}, "prior.standard_deviations.k1"),
        (TANK, {"states": "states: {temperature: true}"}, "system.states.temperature"),
        (TANK, {"states": "states: {temperature: {design: [true, 350 K]}}"}, "design"),
        (TANK, {"inputs: {heat: {range": "inputs: {heat: {range: [0, true]}}"}, "range"),
        (TANK, {"inputs: {heat: {range": "inputs: {heat: {range: [0, 9], rate: true}}"}, "rate"),
    ],
)
def test_study_refuses_true_and_false_where_a_quantity_belongs(text: str, change: dict[str, str], key: str):
    with pytest.raises(StudyError, match="true and false mean nothing here") as caught:
        oed.parse_study(of(text, **change))
    assert [key in str(issue) and issue.line > 0 for issue in caught.value.issues] == [True]


@pytest.mark.filterwarnings("error")
def test_noise_whose_square_is_no_number_is_refused():
    with pytest.raises(StudyError) as caught:
        oed.parse_study(of(POINTS, measurement="measurement: {kind: responses, noise: {b: 1e-300}}"))
    assert [issue.key for issue in caught.value.issues] == ["measurement.noise.b"]
    assert oed.parse_study(of(POINTS, measurement="measurement: {kind: responses, noise: {b: 1e-90}}"))


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_readings_whose_squares_are_no_numbers_are_named_instead_of_the_parameters():
    powers = range(0, 199, 20)
    terms = " + ".join(f"p{power} * t^{power}" for power in powers)
    changes = {
        "inputs: {t: s}": 'inputs: {t: ""}',
        "parameters": f"parameters: {{{', '.join(f'p{power}: 1' for power in powers)}}}",
        "outputs": f"outputs: {{b: {terms}}}",
        "inputs: {t: [0": "inputs: {t: [0, 20]}",
    }
    with pytest.raises(oed.NotFinite, match=r"measurement: the reading of responses at .* beyond 1e\+100"):
        require_identifiable(oed.parse_study(of(POINTS, **changes)).problem)


@pytest.mark.slow
def test_points_are_those_of_the_same_problem_in_python():
    """The study is the problem that Python makes of the same equations."""
    study = oed.parse_study(POINTS)
    solution = oed.solve(study.problem, study.solvers[0], seed=0)
    np.testing.assert_allclose(np.sort(solution.trajectory.inputs.ravel()) / 60, [1.2295, 6.8577], rtol=1e-4)
    again = oed.parse_study(study.text)
    assert again.problem.design == study.problem.design


def test_a_study_written_out_is_itself_a_study():
    """Its echo, defaults filled in, reads as the same problem."""
    study = oed.parse_study(POINTS)
    echo = oed.study.study.read_study(oed.study.yaml_source.PlainSource("echo", "", study.echo()))
    assert echo.problem.model == study.problem.model
    assert echo.problem.limits == study.problem.limits


@pytest.mark.parametrize(
    ("begin", "line", "key", "said"),
    [
        ("points", "points: 0", "experiment.points", "at least 1"),
        ("points", "duration: 3 s", "experiment.duration", "without states"),
        ("inputs: {t: [", "inputs: {t: [0 m, 20 m]}", "experiment.inputs.t", "expected bounds in s"),
        ("inputs: {t: [", "inputs: {u: [0, 1]}", "experiment.inputs.u", "no such input"),
        ("inputs: {t: [", "inputs: {t: [3 s, 1 s]}", "experiment.inputs.t", "expected [least, largest]"),
        ("outputs", "outputs: {b: k1 * tt}", "system.outputs.b", "column 6: unknown name 'tt'"),
        ("outputs", "outputs: {b: k1 + t}", "system.outputs.b", "column 6"),
        ("measurement", "measurement: {kind: responses, noise: {c: 1}}", "measurement.noise.c", "no such"),
        (
            "measurement",
            "measurement: {kind: poses, noise: {position: 1}}",
            "measurement",
            "expected 'outputs'",
        ),
        ("name", "nome: Two", "nome", "unknown key"),
    ],
)
def test_mistakes_are_named_by_line_and_key(begin: str, line: str, key: str, said: str):
    """Each by the key that it is given by."""
    with pytest.raises(StudyError) as error:
        oed.parse_study(of(POINTS, **{begin: line}))
    found = [issue for issue in error.value.issues if issue.key.startswith(key) and said in issue.message]
    assert found, error.value
    assert found[0].line > 0
