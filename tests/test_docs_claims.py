"""What the documentation calls refused is refused; other ways to calibrate are as precise as it says."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from typing import Any

import pytest
import yaml
from pages import PAGES, blocks
from places import ROOT

import oed
from oed.workflow.studies import parse_study

TWO_WHEELS = {
    "format": 1,
    "name": "Two wheels",
    "robot": {"kind": "differential_drive", "wheel_radius": 0.05, "track": 0.2},
    "measurement": {"kind": "poses", "noise": {"position": 0.01, "heading": 0.02}},
    "trajectory": {"duration": 10, "samples": 20},
    "limits": {"wheel_speed": 10},
}
REFUSED = [
    (yaml.safe_load(keys), " ".join(said.split()))
    for keys, said in zip(blocks("when_not", "yaml"), blocks("when_not", "text"), strict=True)
]


@pytest.mark.parametrize(
    ("keys", "said"), REFUSED, ids=lambda part: ", ".join(part) if isinstance(part, dict) else ""
)
def test_what_is_said_to_be_refused_is_refused(keys: dict[str, Any], said: str):
    base = {"format": 1, "name": "refused"} if "system" in keys else TWO_WHEELS
    with pytest.raises(oed.UserMistake) as caught:
        parse_study(yaml.safe_dump({**base, **keys})).require_identifiable()
    assert said in " ".join(str(caught.value).split())


@pytest.mark.slow
@pytest.mark.parametrize(
    "smooth",
    [
        "abs(level - edge)",
        "max(level - edge, 0 * edge)",
        "min(level, edge)",
        "edge * tanh((level - edge) / width)",
    ],
)
def test_kinks_and_smooth_steps_are_taken(smooth: str):
    (keys,) = (one for one, _ in REFUSED if "system" in one)
    system = keys["system"] | {"derivatives": {"level": f"inflow - k * ({smooth})"}}
    system["parameters"] = {**system["parameters"], "width": "1 cm"}
    parse_study(yaml.safe_dump({"format": 1, "name": "taken", **keys, "system": system}))


@pytest.mark.slow
def test_commands_that_take_long_exist():
    commands = [shlex.split(line, comments=True) for line in "".join(blocks("comparison", "sh")).splitlines()]
    make, python = commands
    subprocess.run([make[0], "-n", *make[1:]], cwd=ROOT, check=True, capture_output=True)
    shown = subprocess.run(
        [sys.executable, *python[1:3], "--help"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
    assert python[0] == "python"
    assert all(word in shown for word in python[3:] if word.startswith("--"))


@pytest.mark.slow
def test_squares_and_designs_are_as_precise_as_is_said():
    (text,) = blocks("comparison", "yaml")
    shown = re.findall(
        r"^\| (where|all).*\| ([\d.]+), ([\d.]+) \| ([\d.]+), ([\d.]+) \|$", PAGES["comparison"], re.MULTILINE
    )
    assert [row[0] for row in shown] == ["where", "all"]
    # Where the whole drive is read the first start finds the same; bounds and simulations are not shown.
    for (_, *numbers), every, starts in zip(shown, (80, 1), (2, 1), strict=True):
        study = yaml.safe_load(text) | {"bound": False, "validation": None}
        study["measurement"]["every"] = every
        study["solvers"][0]["starts"] = starts
        results = oed.run(parse_study(yaml.safe_dump(study)), workers=1).results
        errors = {one.name: one.standard_deviations for one in results}
        found = [
            1000 * errors[name][size]
            for name in ("square", "ipopt")
            for size in ("wheel_radius_left", "track")
        ]
        assert found == pytest.approx([float(number) for number in numbers], rel=0.03)
