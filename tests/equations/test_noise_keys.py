"""Noise of outputs: standard deviations in the unit of the output, and what is refused."""

from __future__ import annotations

import pytest

from oed.foundation.errors import StudyError
from oed.workflow.studies import parse_study

TEXT = """\
format: 1
name: A line
system:
  kind: equations
  inputs: {{x: ""}}
  parameters: {{a: 1 {unit}}}
  outputs: {{y: a * x}}
experiment: {{candidates: {{rows: {{x: [0, 1]}}}}}}
measurement: {{kind: responses, noise: {{y: {noise}}}}}
criterion: D
"""


@pytest.mark.parametrize("unit", ['""', "m", "mol/l"])
@pytest.mark.parametrize("noise", ["5 %", "0.5%"])
def test_per_cents_of_an_output_are_refused_at_their_line(unit: str, noise: str):
    """They were read as 0.05 in the output's unit where that is a plain number."""
    unit = "" if unit == '""' else unit
    with pytest.raises(StudyError) as caught:
        parse_study(TEXT.format(unit=unit, noise=noise))
    (issue,) = caught.value.issues
    assert (issue.line, issue.key) == (9, "measurement.noise.y")
    assert noise in issue.message


def test_plain_numbers_are_in_the_unit_of_a_plain_output():
    study = parse_study(TEXT.format(unit="", noise="0.05"))
    assert study.problem.sensors[0].sizes == (0.05,)
