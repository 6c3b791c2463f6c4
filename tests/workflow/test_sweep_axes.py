"""What `--over` asks for: keys, values and their units."""

from __future__ import annotations

import pytest

from oed.foundation.errors import UserMistake
from oed.workflow.sweep import parse_axis


@pytest.mark.parametrize(
    ("text", "values", "numbers", "unit"),
    [
        ("a.b=5,10,20 rad/s", ["5 rad/s", "10 rad/s", "20 rad/s"], (5, 10, 20), "rad/s"),
        ("a = 1 , 2.5", [1, 2.5], (1, 2.5), ""),
        ("a=D,A,modified_E", ["D", "A", "modified_E"], None, ""),
        ("a=50 cm,1 m", ["50 cm", "1 m"], None, ""),
        ("a=5 cm,7 cm", ["5 cm", "7 cm"], (5, 7), "cm"),
        ("a=5,7 %", ["5 %", "7 %"], (5, 7), "%"),
        ("a=-1,+.5 m", ["-1 m", "+.5 m"], (-1, 0.5), "m"),
        ("a=[0, 5],[1 m, 10 m]", [[0, 5], ["1 m", "10 m"]], None, ""),
        ("a={kind: E, scaling: none},{kind: D}", [{"kind": "E", "scaling": "none"}, {"kind": "D"}], None, ""),
        ("a=null,5 rad/s", [None, "5 rad/s"], None, ""),
        ("a=true,false", [True, False], None, ""),
        ("a='x,y',z", ["x,y", "z"], None, ""),
        ("a=turtlebot3_burger,3x_robot", ["turtlebot3_burger", "3x_robot"], None, ""),
    ],
)
def test_values(text: str, values: list, numbers: tuple | None, unit: str):
    axis = parse_axis(text)
    assert list(axis.values) == values
    assert axis.numbers == numbers
    assert axis.unit == unit


def test_a_lists_index_is_a_number():
    assert parse_axis("solvers.0.starts=1").path == ("solvers", 0, "starts")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wheel_speed", "expected KEY=V1"),
        ("=1,2", "expected KEY=V1"),
        ("a..b=1", "expected KEY=V1"),
        ("a=", "expected KEY=V1"),
        ("a=1,,2", "expected KEY=V1"),
        ("a=1,2,1", "1 is given twice"),
        ("a=1,2 m,3 cm", "every value its unit"),
        ("a=[1", "not a value"),
        ("a=!!int x", "not a value"),
        ("a=2024-13-45", "not a value"),
        ("a=&a [*a]", "not a value"),
    ],
)
def test_mistakes(text: str, message: str):
    with pytest.raises(UserMistake, match=message):
        parse_axis(text)
