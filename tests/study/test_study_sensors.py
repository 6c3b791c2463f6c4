"""Sensors, noise and priors in study files: read, echoed, and their mistakes named by line and key."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from studies import SMALL, small
from valid import assert_echo_is_equal, issues_of, line_of

from oed.robots.sensors import PosePrior, Poses, Ranges, Several, YawRate
from oed.workflow.studies import parse_study

SENSORS = """\
format: 1
name: Several sensors
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 10 s, samples: 40, spline: {degree: 3, coefficients: 8}}
measurement:
  - kind: poses
    quantities: [x, y]
    every: 2
    noise:
      position: 1 mm
      position_per_speed: 2 ms
    initial_pose: {position: 1 cm, heading: 2 deg}
    lever_arm: {x: 10 cm, known: false, deviation: 5 mm}
  - kind: yaw_rate
    bias: 0.2 deg/s
    noise: 0.1 deg/s
  - kind: ranges
    beacons: [[3 m, 3 m], [-3 m, 250 cm]]
    noise: 10 cm
    initial_pose: {position: 10 mm, heading: 2 deg}
    lever_arm: {y: -2 cm}
estimate: [wheel_radius_right, track]
prior:
  standard_deviations:
    track: 5 mm
    wheel_radius_right: 2 %
limits:
  wheel_speed: 10 rad/s
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
criterion: {kind: E, subset: [track]}
"""
"""A list of sensors, with every key that sensors have."""


def without(text: str, line: str) -> str:
    """The text without the only line that begins so."""
    lines = text.splitlines(keepends=True)
    del lines[line_of(text, line) - 1]
    return "".join(lines)


def changed(old: str, new: str) -> str:
    assert SENSORS.count(old) == 1, f"{old!r} stands {SENSORS.count(old)} times in the study"
    return SENSORS.replace(old, new)


BROKEN_SENSORS = {
    "unknown key of a sensor": (
        "    every: 2",
        "    evry: 2",
        "evry",
        "measurement.0.evry",
        "did you mean every?",
    ),
    "another sensor's key": (
        "    bias: 0.2 deg/s",
        "    beacons: [[1, 2]]",
        "beacons: [[1, 2",
        "measurement.1.beacons",
        "known here: bias, every, kind, noise",
    ),
    "unknown key inside": (
        "      position: 1 mm",
        "      positon: 1 mm",
        "positon",
        "measurement.0.noise.positon",
        "did you mean position?",
    ),
    "unknown key of a lever arm": (
        "{y: -2 cm}",
        "{z: -2 cm}",
        "lever_arm: {z",
        "measurement.2.lever_arm.z",
        "known here: deviation, known, x, y",
    ),
    "wrong kind of sensor": (
        "kind: yaw_rate",
        "kind: gyroscope",
        "- kind: gyroscope",
        "measurement.1.kind",
        "expected 'poses', 'relative_poses', 'ranges', 'landmarks', 'tags', 'yaw_rate', 'trailer_angle', "
        "'python', got 'gyroscope'",
    ),
    "no sensor": (
        "kind: yaw_rate",
        "kind: displacements",
        "- kind: displacements",
        "measurement.1.kind",
        "got 'displacements'",
    ),
    "no kind": (
        "  - kind: yaw_rate\n    bias: 0.2 deg/s",
        "  - bias: 0.2 deg/s",
        "- bias",
        "measurement.1",
        "the key kind is missing",
    ),
    "wrong unit": (
        "noise: 10 cm",
        "noise: 10 deg",
        "noise: 10 deg",
        "measurement.2.noise",
        "expected a length [m], got '10 deg'",
    ),
    "wrong unit inside": (
        "position_per_speed: 2 ms",
        "position_per_speed: 2 m",
        "position_per_speed",
        "measurement.0.noise.position_per_speed",
        "expected a time [s], got '2 m'",
    ),
    "no noise": (
        "    noise: 0.1 deg/s\n",
        "",
        "- kind: yaw_rate",
        "measurement.1.noise",
        "missing",
    ),
    "noise of too few quantities": (
        "[x, y]",
        "[x, heading]",
        "noise:",
        "measurement.0.noise",
        "the noise of heading is needed to weight the readings",
    ),
    "negative noise": (
        "noise: 10 cm",
        "noise: -10 cm",
        "noise: -10 cm",
        "measurement.2.noise",
        "expected more than 0",
    ),
    "no such quantity": (
        "[x, y]",
        "[x, z]",
        "quantities",
        "measurement.0.quantities.1",
        "expected 'x', 'y' or 'heading', got 'z'",
    ),
    "quantity twice": ("[x, y]", "[x, x]", "quantities", "measurement.0.quantities", "listed twice"),
    "never": ("every: 2", "every: 0", "every", "measurement.0.every", "expected at least 1, got 0"),
    "wrong bias": ("bias: 0.2 deg/s", "bias: some", "bias", "measurement.1.bias", "got 'some'"),
    "beacon without y": (
        "[-3 m, 250 cm]",
        "[-3 m]",
        "beacons",
        "measurement.2.beacons.1.1",
        "missing",
    ),
    "deviation of a known arm": (
        "{y: -2 cm}",
        "{y: -2 cm, deviation: 1 mm}",
        "lever_arm: {y",
        "measurement.2.lever_arm",
        "add known: false",
    ),
    "another initial pose": (
        "{position: 10 mm, heading: 2 deg}",
        "{position: 2 cm, heading: 2 deg}",
        "initial_pose: {position: 2 cm",
        "measurement.2.initial_pose",
        "differs from that of the sensors before",
    ),
    "an initial pose left out": (
        "    initial_pose: {position: 10 mm, heading: 2 deg}\n",
        "",
        "- kind: ranges",
        "measurement.2",
        "there is one initial pose",
    ),
    "half an initial pose": (
        "{position: 10 mm, heading: 2 deg}",
        "{position: 10 mm}",
        "initial_pose: {position: 10 mm",
        "measurement.2.initial_pose.heading",
        "missing",
    ),
    "unknown parameter": (
        "[wheel_radius_right, track]",
        "[wheel_radius, track]",
        "estimate",
        "estimate",
        "yaw_rate.bias), got wheel_radius, track; did you mean wheel_radius_right or wheel_radius_left?",
    ),
    "parameters of both kinds": (
        "[wheel_radius_right, track]",
        "[c11, track]",
        "estimate",
        "estimate",
        "got c11, track",
    ),
    "parameter twice": (
        "[wheel_radius_right, track]",
        "[track, track]",
        "estimate",
        "estimate",
        "listed twice",
    ),
    "no parameters": (
        "[wheel_radius_right, track]",
        "[]",
        "estimate",
        "estimate",
        "at least one parameter",
    ),
    "parameters that are no list": (
        "[wheel_radius_right, track]",
        "track",
        "estimate",
        "estimate",
        "expected a list, got 'track'",
    ),
    "prior of what is not estimated": (
        "    track: 5 mm",
        "    wheel_radius_left: 5 mm",
        "wheel_radius_left",
        "prior.standard_deviations.wheel_radius_left",
        "the parameters are wheel_radius_right, track",
    ),
    "prior of a wrong unit": (
        "track: 5 mm",
        "track: 5 kg",
        "track: 5 kg",
        "prior.standard_deviations.track",
        "expected a length [m], got '5 kg'",
    ),
    "negative prior": (
        "track: 5 mm",
        "track: -5 %",
        "track: -5 %",
        "prior.standard_deviations.track",
        "expected a positive standard deviation, got '-5 %'",
    ),
    "unknown key of a prior": (
        "  standard_deviations:",
        "  standard_deviation:",
        "standard_deviation",
        "prior.standard_deviation",
        "did you mean standard_deviations?",
    ),
    "empty prior": (
        "  standard_deviations:\n    track: 5 mm\n    wheel_radius_right: 2 %",
        "  {}",
        "prior",
        "prior",
        "either standard_deviations, or parameters and their covariance",
    ),
    "both priors": (
        "  standard_deviations:",
        "  parameters: [track]\n  covariance: [[1]]\n  standard_deviations:",
        "prior",
        "prior",
        "either standard_deviations, or parameters and their covariance",
    ),
    "prior covariance of another size": (
        "  standard_deviations:\n    track: 5 mm\n    wheel_radius_right: 2 %",
        "  parameters: [track]\n  covariance: [[1, 0], [0, 1]]",
        "prior",
        "prior",
        "expected a 1 x 1 covariance for 1 parameters",
    ),
    "prior covariance of what is not estimated": (
        "  standard_deviations:\n    track: 5 mm\n    wheel_radius_right: 2 %",
        "  covariance: [[1]]\n  parameters: [wheel_radius_left]",
        "parameters",
        "prior.parameters",
        "wheel_radius_left is not estimated here",
    ),
    "judged but not estimated": (
        "subset: [track]",
        "subset: [wheel_radius_left]",
        "criterion",
        "criterion.subset",
        "expected some of the estimated wheel_radius_right, track, got wheel_radius_left",
    ),
}


LANDMARKS = "{kind: landmarks, landmarks: [[1 m, 1 m]], noise: {range: 1 cm, bearing: 1 deg}"
TAGS = "{kind: tags, tags: [[1 m, 1 m, 0 deg]], noise: {range: 1 cm, bearing: 1 deg, orientation: 1 deg}"


@pytest.mark.parametrize(
    ("sensor", "key"),
    [
        (f"{LANDMARKS}, map: -1 cm}}", "map"),
        (f"{LANDMARKS}, quantities: [orientation]}}", "quantities.0"),
        (LANDMARKS.replace("1 deg", "1 m") + "}", "noise.bearing"),
        (LANDMARKS.replace("range: 1 cm, bearing: 1 deg", "3 cm") + "}", "noise.3 cm"),
        (LANDMARKS.replace("[[1 m, 1 m]]", "[[1 m]]") + "}", "landmarks.0.1"),
        (LANDMARKS.replace(" landmarks: [[1 m, 1 m]],", "") + "}", "landmarks"),
        (f"{TAGS}, map: {{position: 5 cm}}}}", "map.heading"),
        (f"{TAGS}, lever_arm: {{heading_deviation: 3 cm}}}}", "lever_arm.heading_deviation"),
        (TAGS.replace(", 0 deg", "") + "}", "tags.0.2"),
    ],
)
def test_what_is_named_as_its_kind(sensor: str, key: str):
    """Mistakes beside the landmarks, the tags, are not theirs."""
    for text, place in ((sensor, "measurement"), (f"[{sensor}]", "measurement.0")):
        (issue,) = issues_of(f"{without(SMALL, 'measurement:')}measurement: {text}\n")
        assert issue.key == f"{place}.{key}"


class TestSensors:
    """Lists of sensors, and what is estimated from them."""

    def test_everything_given_is_read(self):
        problem = parse_study(SENSORS).problem
        poses, rates, ranges = problem.measurement.sensors
        start = PosePrior(position=0.01, heading=np.deg2rad(2))
        assert isinstance(problem.measurement, Several)
        assert poses == Poses(
            quantities=("x", "y"),
            every=2,
            noise={"position": 1e-3, "position_per_speed": 2e-3},
            initial_pose=start,
            lever_arm={"x": 0.1, "known": False, "deviation": 5e-3},
        )
        assert isinstance(rates, YawRate)
        assert (rates.noise, rates.bias) == pytest.approx((np.deg2rad(0.1), np.deg2rad(0.2)))
        assert ranges == Ranges(
            beacons=((3, 3), (-3, 2.5)), noise=0.1, initial_pose=start, lever_arm={"y": -0.02}
        )
        assert problem.estimate == ("wheel_radius_right", "track")
        assert problem.prior.standard_deviations == {"track": "5 mm", "wheel_radius_right": "2 %"}

    @pytest.mark.parametrize(
        "text",
        [
            SENSORS,
            without(SENSORS, "estimate:"),
            changed("estimate: [wheel_radius_right, track]", "estimate: [track, wheel_radius_right]"),
            changed("bias: 0.2 deg/s", "bias: known"),
            changed("    bias: 0.2 deg/s\n", ""),
            changed("[x, y]", "[heading]").replace("position: 1 mm", "heading: 1 deg"),
            SENSORS.replace("{position: 1 cm, heading: 2 deg}", "known").replace(
                "{position: 10 mm, heading: 2 deg}", "known"
            ),
            changed("position: 1 mm", "covariance: [[1e-6, 1e-7], [1e-7, 2e-6]]").replace(
                "      position_per_speed: 2 ms\n", ""
            ),
            SMALL.replace(
                "{kind: displacements, segments: 4, noise: {position: 1 cm, heading: 1 deg}}",
                "[{kind: yaw_rate, noise: 0.1}]",
            ),
            SMALL.replace("{kind: displacements, segments: 4,", "{kind: poses,"),
            SMALL.replace("segments: 4,", "segments: 4, noise_model: absolute, estimator: ols,"),
            small(estimate="[c21]"),
        ],
        ids=[
            "full",
            "all parameters",
            "in another order",
            "known bias",
            "unknown bias",
            "headings",
            "known start",
            "covariance",
            "list of one",
            "no list",
            "absolute displacements",
            "some coefficients",
        ],
    )
    @pytest.mark.slow
    def test_an_echo_is_the_same_study(self, text: str):
        assert_echo_is_equal(text)
        study, again = parse_study(text), parse_study(yaml.safe_dump(parse_study(text).echo()))
        assert (again.problem.estimate, again.problem.prior) == (study.problem.estimate, study.problem.prior)

    @pytest.mark.slow
    def test_a_prior_covariance_is_echoed_too(self):
        prior = "prior: {parameters: [track, wheel_radius_right], covariance: [[1e-6, 1e-7], [1e-7, 4e-8]]}\n"
        text = SENSORS[: SENSORS.index("prior:")] + prior + SENSORS[SENSORS.index("limits:") :]
        assert_echo_is_equal(text)
        again = parse_study(yaml.safe_dump(parse_study(text).echo())).problem.prior
        assert again == parse_study(text).problem.prior
        assert again.covariance == ((1e-6, 1e-7), (1e-7, 4e-8))

    def test_a_list_is_short_for_several(self):
        listed = parse_study(SENSORS)
        assert listed.echo()["measurement"]["kind"] == "several"
        assert [sensor["kind"] for sensor in listed.echo()["measurement"]["sensors"]] == [
            "poses",
            "yaw_rate",
            "ranges",
        ]

    @pytest.mark.parametrize(
        ("old", "new", "line", "key", "message"), BROKEN_SENSORS.values(), ids=BROKEN_SENSORS.keys()
    )
    def test_one_mistake_is_named_by_its_line_and_key(
        self, old: str, new: str, line: str, key: str, message: str
    ):
        text = changed(old, new)
        issues = issues_of(text)
        place = [number for number, each in enumerate(text.splitlines(), 1) if each.strip().startswith(line)]
        assert [(issue.line, issue.key) for issue in issues] == [(place[0], key)]
        assert message in issues[0].message

    def test_mistakes_in_several_sensors_are_reported_at_once(self):
        text = changed("every: 2", "every: 0").replace("bias: 0.2 deg/s", "bias: -1")
        text = text.replace("beacons: [[3 m,", "beacons: [[3 kg,").replace("track: 5 mm", "track: [1]")
        expected = [
            ("every", "measurement.0.every"),
            ("bias", "measurement.1.bias"),
            ("beacons", "measurement.2.beacons.0.0"),
            ("track: [1]", "prior.standard_deviations.track"),
        ]
        found = [(issue.line, issue.key) for issue in issues_of(text)]
        assert found == [(line_of(text, line), key) for line, key in expected]

    def test_a_prior_without_noise_has_nothing_to_be_weighed_against(self):
        text = small(prior="{standard_deviations: {c21: 1 mm}}")
        (issue,) = issues_of(text)
        assert (issue.line, issue.key) == (line_of(text, "prior"), "prior")
        assert "scaling: relative" in issue.message

    def test_what_displacements_do_not_identify(self):
        text = small(estimate="[track]")
        (issue,) = issues_of(text)
        assert (issue.line, issue.key) == (line_of(text, "estimate"), "estimate")
        assert "track cannot be estimated from displacements, which identify c21, c22" in issue.message

    @pytest.mark.parametrize("value", ["[]", "[3]", "[[]]"])
    def test_lists_of_no_sensors(self, value: str):
        begin, end = SENSORS.index("measurement:"), SENSORS.index("estimate:")
        text = f"{SENSORS[:begin]}measurement: {value}\n{SENSORS[end:]}"
        (issue,) = issues_of(text)
        assert issue.line == line_of(text, "measurement")
        assert issue.key in ("measurement", "measurement.0")

    def test_robust_losses_under_drift(self):
        # Simulated experiments were left out without a word.
        study = {
            **{key: yaml.safe_load(SENSORS)[key] for key in ("format", "name", "robot", "trajectory")},
            "measurement": {"kind": "poses", "noise": {"position": 0.01, "heading": 0.02}, "drift": "usual"},
            "limits": {"wheel_speed": 10},
            "validation": {"replicates": 100, "loss": "huber"},
        }
        text = yaml.safe_dump(study)
        (issue,) = issues_of(text)
        assert issue.key == "validation.loss"
        assert "does not go with drift" in issue.message
        study["validation"]["loss"] = "linear"
        parse_study(yaml.safe_dump(study))
