"""The page of an estimate: what the data say stands in it, whatever of the data is missing."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from sample_estimates import KINDS, ODD, Data, bare, estimate, many, part, path, read

from oed.cli.terminal.console import WIDTH, print_estimate
from oed.foundation.text import decimals_of, error_text, size_text, to_error
from oed.report import write_estimate
from oed.report.estimate import estimate_sections
from oed.report.estimate.parameters import estimate_lines, estimate_rows, gains, warnings
from oed.report.figures.calibration import residuals, residuals_of
from oed.report.figures.reckoned import LOOKS, errors
from oed.report.parts.section import Section, Table, lasting, span_text

pytestmark = pytest.mark.usefixtures("drawn_once")


def section(data: Data, title: str) -> Section:
    return next(one for one in estimate_sections(read(data)) if one.title == title)


def table(part_: Section, caption: str) -> Table:
    return next(one for one in part_.tables if one.caption.startswith(caption))


def visible(html: str) -> str:
    return re.sub(r"<style>.*?</style>|<[^>]*>", " ", html, flags=re.S)


def test_errors_are_drawn_over_the_time_since_the_start():
    (reckoned, *_) = read({**estimate(), "paths": [path("drive", "fitted")]}).paths
    stamped = reckoned.model_copy(update={"t": tuple(1.7e9 + time for time in reckoned.t)})
    for panel in errors([stamped]).panels:
        assert all(line.x[0] == 0 and line.x[-1] == pytest.approx(5.0) for line in panel.parts)


def test_who_designed_no_drive_is_not_sent_to_the_folder_of_one():
    data = estimate()
    designed, alone = ({**data["study"], "trajectory": own} for own in ({"duration": 60.0}, None))
    said = [" ".join(section({**data, "study": study}, "Summary").paragraphs) for study in (designed, alone)]
    assert "oed next DIR LOG" in said[0]
    assert "oed next" not in said[1]
    assert "add `trajectory` and `limits` to the study" in said[1]


@pytest.fixture(scope="module")
def undrawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a page without figures, which take long."""
    folder = tmp_path_factory.mktemp("undrawn")
    write_estimate(read({**estimate(), "residuals": [], "paths": []}), folder)
    return folder


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("estimate")
    assert write_estimate(read(estimate()), folder) == folder / "estimate.html"
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_estimate_gets_a_whole_page(kind: str, tmp_path: Path):
    html = write_estimate(read(KINDS[kind]()), tmp_path).read_text(encoding="utf-8")
    markdown = (tmp_path / "estimate.md").read_text(encoding="utf-8")
    files = {file.name for file in (tmp_path / "figures").glob("*")}
    assert set(re.findall(r"\]\(figures/([^)]*)\)", markdown)) == files
    assert all(name.startswith("estimate_") for name in files)
    assert html.count("<svg") == len(files)
    for file in (tmp_path / "figures").glob("*"):
        assert file.stat().st_size < 200_000
        ElementTree.parse(file)
    for text in (visible(html), markdown):
        assert not {"nan", "None", "inf", "NaN"} & set(re.findall(r"[A-Za-z]+", text))
    assert "src=" not in html
    assert "@import" not in html


@pytest.mark.slow
def test_the_page_says_what_the_data_say(undrawn: Path):
    text = (undrawn / "estimate.md").read_text(encoding="utf-8")
    assert "| wheel radius | mm | 42 | 41.852 | 0.013 | 41.826 to 41.878 | -0.352 |" in text
    assert "position error (RMS) from 45.2 mm to 21.0 mm" in text
    assert "heading error (RMS) from 2.59 deg to 1.20 deg" in text
    assert "| sensor ahead of" not in text
    assert "| pose sensor ahead of the robot's origin | mm | 1.200 | 0.080 |" in text
    assert "| position | 0.600 mm | 4.00 mm per m/s | none found |" in text
    assert "| heading | 0.344 deg | none found | 0.573 deg per rad/s |" in text
    assert "| c11 | 1 | 0.20810 | 0.00044 |" in text
    assert "first +213 ms" in text
    assert "| residuals are white | position | not passed | 2.50 | \\< 0.0001 |" in text
    assert "F⁻¹ promises too much" in text
    assert "differential_drive" in text.split("## Provenance")[1]


def test_odd_names_mean_themselves(undrawn: Path):
    html = (undrawn / "estimate.html").read_text(encoding="utf-8")
    assert "<i>" not in html
    assert "a|b &lt;i&gt;$x$ `run` *1*" in html
    assert "Small &lt;robot&gt;" in html
    markdown = (undrawn / "estimate.md").read_text(encoding="utf-8")
    assert r"a\|b \<i\>\$x\$ \`run\` \*1\*" in markdown


@pytest.mark.slow
def test_figures_are_those_of_the_page(written: Path):
    names = ("paths", "errors", "residuals_heading", "residuals_position")
    assert {file.name for file in (written / "figures").iterdir()} == {f"estimate_{one}.svg" for one in names}
    drawn = (written / "figures" / "estimate_paths.svg").read_text(encoding="utf-8")
    assert "a|b &lt;i&gt;$x$ `run` *1*" in drawn


@pytest.mark.slow
def test_paths_are_told_apart_without_colour(written: Path):
    drawn = (written / "figures" / "estimate_paths.svg").read_text(encoding="utf-8")
    for look in LOOKS:
        assert f"stroke-width: {look['linewidth']:g}" in drawn
    assert len({(look["linewidth"], look["linestyle"]) for look in LOOKS}) == 3


def test_warnings_come_first():
    data = estimate()
    data.update(converged=False, untold=["the logs do not tell track: fix it"], notes=["sensor_y is hidden"])
    data["held_out"] = part(["apart"], 0.02, 0.03)
    made = section(data, "Summary")
    notices = made.notices
    assert notices[0].startswith("The search did not converge")
    assert notices[1] == "The logs do not tell track: fix it."
    assert "is worse: drift over 1 m of path, position error (RMS) and heading error (RMS)" in notices[3]
    assert notices[2] == f"{ODD}: 1 gap in the inputs; the longest is 2 s from row 7."
    assert len(notices) == 4
    # What was decided on the way is no warning: it stands below the estimates.
    assert made.remarks == ("Sensor_y is hidden.",)


def test_failed_tests_matter_where_error_bars_rest_on_them():
    data = estimate()
    data["covariance_kind"] = "bootstrap"
    assert not any("white" in text for text in warnings(read(data)))
    data["covariance_kind"] = "information"
    assert "Position residuals are not white: F⁻¹ promises too much." in warnings(read(data))


def test_logs_that_differ_matter_unless_error_bars_allow_for_that():
    data, text = estimate(), "the logs differ"
    one = next(one for one in data["diagnostics"] if one["name"] == "logs_agree")
    one.update(passed=False, message=text)
    data["covariance_kind"] = "drift"
    for allowed, said in ((False, True), (True, False), (None, False)):
        one["allowed_for"] = allowed
        assert ("The logs differ." in warnings(read(data))) is said


def test_coefficients_have_intervals_of_their_own():
    data = estimate()
    assert "95 % interval" not in [
        one.title for one in table(section(data, "Nuisance parameters"), "Coeff").columns
    ]
    data["coefficients"][0]["interval"] = [0.2071, 0.2091]
    data["half_width_together"] = 2.27
    found = table(section(data, "Nuisance parameters"), "Coefficients that these give; intervals reach 2.27")
    assert found.rows[0][-1] == "0.20710 to 0.20910"


def test_means_are_of_the_logs_that_have_the_number():
    data = estimate()
    data["held_out"] = None
    data["left_out"][0]["before"][0]["rmse_heading"] = None
    (text,) = gains(read(data))
    assert text.startswith("Dead reckoning of each log, by the estimate from the others")
    assert "position error (RMS) from 45.0 mm to 25.0 mm" in text
    assert "heading error (RMS) from 2.29 deg to 1.15 deg" in text


@pytest.mark.slow
def test_hundreds_of_logs_stay_readable():
    record = read(many())
    made = {one.title: one for one in estimate_sections(record)}
    for one in made.values():
        assert all(len(table_.rows) <= 18 for table_ in one.tables)
    logs = made["Logs"]
    names = [row[1] for row in table(logs, "Logs").rows]
    assert names[:4] == ["drive_002", "drive_102", "drive_202", "drive_302"]
    assert names[-1] == "and 385 more"
    found = table(logs, "What was found").rows
    assert [row[:3] for row in found] == [("pose jump", 4.0, True), ("stationary end", 400.0, False)]
    left = table(made["Cross-validation and test set"], "Cross-validation: each log by an estimate")
    assert left.rows[0][0] == "drive_399"
    assert [row[0] for row in left.rows[-2:]] == ["and 385 more, on average", "mean of all 400"]
    (doubt,) = [text for text in warnings(record) if "jumps" in text]
    assert doubt == "drive_002: the pose jumps once (and something alike in 3 other logs)."


def test_segments_and_ways_to_errors_are_side_by_side():
    made = section(estimate(), "What the error bars rest on")
    errors = table(made, "Standard errors")
    assert [column.title for column in errors.columns[2:]] == ["information", "sandwich", "bootstrap (used)"]
    segments = table(made, "Size of the residuals")
    assert [row[0] for row in segments.rows] == ["1 s", "2 s", "whole logs"]
    assert [row[-1] for row in segments.rows] == ["", "chosen", ""]
    assert "2 times those that F⁻¹ predicts" in made.paragraphs[1]


def test_estimates_of_other_parameters_than_these_are_not_mistaken():
    data = estimate()
    data["left_out"][0]["parameters"] = [0.1, 0.2, 0.3]
    made = section(data, "Cross-validation and test set")
    assert not any(one.caption.startswith("Estimates without") for one in made.tables)


def test_models_are_compared():
    made = section(estimate(), "Model selection")
    assert made.notices == (
        f"{ODD}: its search did not converge.",
        "skid steer cannot be compared: the logs do not tell slip_outer.",
    )
    best = "wide track is the best by AICc, BIC and cross-validation"
    assert made.paragraphs[0] == f"Of 3 models {best}."
    assert "so that 4 readings count as one, judged by how much successive parts" in made.paragraphs[1]
    assert "of 4000 there remain 1000" in made.paragraphs[1]
    assert "they weigh against" not in made.paragraphs[1]
    likely = table(made, "Models by likelihood").cells
    assert likely[0] == [
        "differential drive (the study's)",
        "2",
        "9",
        "432.1",
        "21.0",
        "17.0",
        "9.0",
        "worse",
    ]
    assert likely[1][4:] == ["0.0", "0.0", "–", "best"]
    assert likely[2][4:] == ["1.0", "7.0", "4.0", "practically equal by AICc"]
    told = table(made, "Models by cross-validated").cells
    assert told[0][1:] == ["31.1", "48.1", "19.0 to 81.0", "worse"]
    assert told[2][4] == "practically equal"
    assert table(made, "What each model").cells[0][1:] == ["wheel radius", "mm", "200.0", "1.0"]


def test_states_of_starts_are_told():
    data = estimate()
    data["comparison"]["models"][1]["starts"] = 24.0
    made = section(data, "Model selection")
    assert (
        "(24 of wide track): they weigh against such a model where segments are short" in made.paragraphs[1]
    )
    assert table(made, "Models by likelihood").cells[1][2] == "33"


def test_models_that_do_not_agree_are_told_so():
    data = estimate()
    data["comparison"]["best"]["bic"] = "differential_drive"
    first = section(data, "Model selection").paragraphs[0]
    assert "wide track is the best by AICc and cross-validation; differential drive" in first
    assert first.endswith("As good as the best by all 3: wide track.")
    data["comparison"]["favourites"] = []
    assert section(data, "Model selection").paragraphs[0].endswith("They disagree.")


def test_models_of_a_robust_loss_are_compared_by_prediction_alone():
    data = estimate()
    data["study"]["calibration"] = {"loss": "huber"}
    data["comparison"]["best"] = {"held_out": "wide_track"}
    for one in data["comparison"]["models"]:
        one["scores"] = {key: value for key, value in one["scores"].items() if key == "held_out"}
    made = section(data, "Model selection")
    assert made.paragraphs[1].startswith("A robust loss is no likelihood")
    assert [one.caption for one in made.tables] == [
        "Models by cross-validated dead reckoning",
        "What each model is fitted with",
    ]


def test_a_single_log_without_positions_leaves_sections_out():
    titles = [one.title for one in estimate_sections(read(bare()))]
    assert titles == ["Summary", "Before and after", "What the error bars rest on", "Logs", "Provenance"]


def alone() -> Data:
    """The estimate from one log, which nothing else has tested."""
    passed = [{**one, "passed": True} for one in estimate()["diagnostics"]]
    only = {"logs": estimate()["logs"][:1], "left_out": [], "held_out": None, "diagnostics": passed}
    return {**estimate(), **only, "paths": [path("first", "fitted")]}


def test_the_page_begins_with_the_path_before_and_after():
    (picture,) = section(estimate(), "Summary").figures
    assert picture.name == "estimate_paths"
    assert section(estimate(), "Summary").tables[0].columns[0].title == "parameter"
    assert section(alone(), "Summary").figures[0].caption.startswith("Odometry of the log that was fitted,")
    for panel in picture.figure.panels:
        # The reference is in front of both.
        reference, *others = (part.look["zorder"] for part in panel.parts)
        assert reference > max(others[:2])


def test_the_headline_is_what_odometry_gains_where_the_estimate_knows_least():
    def headline(data: Data) -> str:
        return section(data, "Summary").paragraphs[0]

    before, after = (estimate()["held_out"][when][0]["rmse_position"] for when in ("before", "after"))
    sizes = f"{size_text(before, 'm')} before, {size_text(after, 'm')} after"
    assert headline(estimate()) == f"Odometry's position error: {sizes}, on the test log"
    assert headline(alone()).endswith("10.0 mm after, on the log that was fitted")
    # Without positions the parameter that changed most, in words.
    unmeasured = {**alone(), "paths": []}
    one = max(unmeasured["parameters"], key=lambda one: abs(one["value"] / one["nominal"] - 1))
    change = 100 * (one["value"] / one["nominal"] - 1)
    assert f"{abs(change):.2g} % {'larger' if change > 0 else 'smaller'} than nominal" in headline(unmeasured)


def test_the_first_screen_says_the_same_as_the_table_of_intervals():
    made = section(estimate(), "Summary")
    (brief,), (whole,) = made.tables, made.folds[0].tables
    for short, row in zip(brief.cells, whole.cells, strict=True):
        assert short[0] == row[0]
        assert short[2].startswith(f"{row[3]} ± {row[4]}")
        assert short[3] == row[6]


def test_errors_over_time_are_those_of_the_paths():
    made = section(alone(), "Error over time")
    position, heading = made.figures[0].figure.panels
    (one,) = read(alone()).paths
    drawn = position.parts[0]
    assert position.y.label == "position error [mm]"
    measured, before, _ = one.paths
    assert drawn.y == pytest.approx(1e3 * np.linalg.norm(before - measured, axis=1), nan_ok=True)
    assert (heading.y.label, heading.x.label) == ("heading error [deg]", "time [s]")
    assert heading.parts[0].y == pytest.approx(np.degrees(0.1 * np.linspace(0.0, 5.0, 30)))


def test_without_headings_the_position_alone_is_drawn():
    data = alone()
    data["paths"][0]["heading"] = None
    (panel,) = section(data, "Error over time").figures[0].figure.panels
    assert panel.x.label == "time [s]"
    data["paths"][0]["t"] = None
    assert section(data, "Error over time").figures == ()


def test_pose_errors_go_by_evos_names_for_one_log_too():
    (made,) = section(alone(), "Error over time").tables
    assert made.caption == "Errors of odometry of the log that was fitted"
    assert made.cells[0] == ["APE, position, aligned at the start", "40.0 mm", "10.0 mm"]
    assert [row[0].split(",")[0] for row in made.cells] == ["APE"] * 3 + ["RPE over 1 m"] * 2
    # Logs that the estimate does not know come first.
    (made,) = section(estimate(), "Error over time").tables
    assert made.caption == "Errors of odometry of the test log"
    assert made.cells[0][1:] == ["45.2 mm", "21.0 mm"]


def test_trust_is_one_sentence_with_its_reason():
    def said(data: Data) -> str:
        return section(data, "Summary").paragraphs[1]

    doubtless = {**estimate(), "logs": alone()["logs"], "diagnostics": alone()["diagnostics"]}
    assert said(doubtless).startswith("The estimates can be trusted: every test of the fit is passed")
    assert said(estimate()).startswith("Take the estimates with care: what is said first on this page")
    failed = {**doubtless, "diagnostics": estimate()["diagnostics"]}
    assert said(failed) == "Take the estimates with care: 1 of 2 tests of the fit is not passed."
    assert said(alone()).endswith("no other log has tested them. A second drive would.")
    assert "`oed next DIR LOG`" in section(alone(), "Summary").paragraphs[-1]


def test_residuals_are_drawn_in_units_that_suit_them():
    position, heading = residuals_of(read(estimate()))
    assert (position.unit, heading.unit) == ("mm", "deg")
    assert position.at_rest == pytest.approx(0.6)
    assert list(position.quantities) == ["x", "y"]
    windows = residuals_of(read({**estimate(), "method": "gls"}))[0]
    assert windows.at_rest is None
    normal, found = position.against_normal()
    assert np.all(np.diff(normal) > 0)
    assert np.all(np.diff(found) >= 0)


def likeliest(**changes: object) -> Data:
    error = {
        "name": "position",
        "kind": "noise",
        "about": "position",
        "unit": "m",
        "size": 2e-5,
        "interval": [1e-6, 4e-4],
    }
    return {**estimate(), "method": "likelihood", "log_errors": [error], **changes}


def test_distances_from_the_likeliest_path_are_not_held_against_the_white_noise_alone():
    (position, _) = residuals_of(read(likeliest()))
    rms = np.sqrt(np.mean(position.everything.values**2))
    assert position.size(np.zeros(1), np.zeros(1)) == pytest.approx(rms)
    assert "residual / size" in [panel.y.title for panel in residuals(position).panels]
    said = section(likeliest(), "Does the fit hold")
    assert "The figures show all that parts readings from the most likely path" in " ".join(said.paragraphs)
    assert "their size in all" in said.pictures[0].caption
    assert "correlation of innovations with those" in said.pictures[0].caption


@pytest.mark.parametrize("chosen", [True, False])
def test_the_likeliest_path_is_said_to_be_what_was_fitted(chosen: bool):
    segments = {"seconds": None, "count": 2, "chosen": chosen, "drifts": True, "tried": []}
    sections = estimate_sections(read(likeliest(segments=segments)))
    said = " ".join(text for one in sections for text in one.paragraphs)
    assert "estimated by the likelihood of whole logs" in said
    assert "What is fitted is the most likely path of whole logs" in said


@pytest.mark.parametrize(
    ("error", "decimals"), [(0.013, 3), (0.0996, 2), (41.0, 0), (0.0, None), (None, None), (math.inf, None)]
)
def test_decimals_go_down_to_the_errors_second_digit(error: float | None, decimals: int | None):
    assert decimals_of(error) == decimals


def test_numbers_are_read_easily():
    assert to_error(0.0418519676, 1.2884e-05, 1e3) == "41.852"
    assert to_error(None, 1.0) == "–"
    assert to_error(1.0, None) == "1.0000"
    assert error_text(3e9) == "3.0e9"
    assert span_text(None, 1.0, 0.1, 1.0) == "–"
    assert size_text(0.0452, "m") == "45.2 mm"
    assert size_text(3.25, "m") == "3.25 m"
    assert size_text(0.0, "m") == "0 mm"
    assert [lasting(one) for one in (48.2, 416.0, 11100.0)] == ["48.2 s", "6 min 56 s", "3 h 5 min"]


def test_the_design_report_beside_it_is_left_alone(tmp_path: Path):
    (tmp_path / "report.html").write_text("design", encoding="utf-8")
    write_estimate(read(bare()), tmp_path)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "design"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["estimate.html", "estimate.md", "report.html"]


def test_plain_data_are_refused(tmp_path: Path):
    with pytest.raises(TypeError, match="expected an EstimateRecord"):
        write_estimate(estimate(), tmp_path)


@pytest.mark.parametrize(
    ("pieces", "said"),
    [(0, "over whole logs ({} in all)"), (7, "over whole logs ({}, which gaps part into {} pieces)")],
)
def test_pieces_of_logs_are_no_logs(pieces: int, said: str):
    data = estimate()
    logs = len(data["logs"])
    data["segments"] |= {"seconds": None, "count": logs + pieces, "drifts": False}
    assert said.format(logs, logs + pieces) in " ".join(
        section(data, "What the error bars rest on").paragraphs
    )


@pytest.mark.parametrize(
    ("drifts", "on_page", "on_console"),
    [
        (
            True,
            "the robot drifts, by slip or an uneven floor, but stays within",
            "whole logs (2 in all), which drift.",
        ),
        (
            False,
            "no drift shows beside the sensors' noise",
            "whole logs (2 in all), which show no drift.",
        ),
        (None, "they are too short to show whether there is", "whole logs (2 in all). Standard"),
    ],
)
def test_whether_whole_logs_drift_is_said(capsys, drifts: bool | None, on_page: str, on_console: str):
    data = estimate()
    data["logs"] = data["logs"][:2]
    data["segments"] |= {"seconds": None, "count": 2, "drifts": drifts}
    data["covariance_kind"] = "drift"
    paragraphs = section(data, "What the error bars rest on").paragraphs
    assert on_page in " ".join(paragraphs[0].split())
    assert paragraphs[1].startswith(
        "Standard errors are those under drift: F⁻¹MF⁻¹ with the covariance M that"
    )
    print_estimate(read(data))
    text = " ".join(capsys.readouterr().out.split())
    assert on_console in text
    assert "Standard errors are as large as the noise of the readings and the robot's drift make them" in text


def test_the_console_tells_the_same(capsys: pytest.CaptureFixture[str]):
    data = estimate()
    data["notes"] = ["sensor_y is hidden"]
    print_estimate(read(data))
    lines = capsys.readouterr().out
    row = next(line for line in lines.splitlines() if line.startswith("wheel radius"))
    assert row.split()[2:6] == ["mm", "42", "41.852", "0.013"]
    assert row.endswith("-0.352")
    assert max(map(len, lines.split("Fitted to")[0].splitlines())) <= WIDTH
    text = " ".join(lines.split())
    assert "Fitted to segments of 2 s (70 in all), as longer ones drift." in text
    assert "spread of estimates from parts of the logs, drawn again and again; a 95 % interval" in text
    assert "wheels' clock ahead of the poses': first +213 ms" in text
    assert "position error (RMS) from 45.2 mm to 21.0 mm" in text
    assert "warning: a|b <i>$x$ `run` *1*: 1 gap in the inputs" in text
    assert "note: Sensor_y is hidden." in text
    assert (
        "model wide track: 3 parameters, AICc best, BIC best, cross-validated position error 21.0 mm" in text
    )
    assert "model skid steer: not comparable: the logs do not tell slip_outer" in text


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.slow
def test_the_console_copes_with_what_is_missing(kind: str, capsys: pytest.CaptureFixture[str]):
    print_estimate(read(KINDS[kind]()))
    assert not {"nan", "None", "NaN"} & set(re.findall(r"[A-Za-z]+", capsys.readouterr().out))


@pytest.mark.parametrize("nominal", [0.0, 1.2e-16])
def test_what_is_nominally_0_but_for_rounding_has_no_change_in_percent(nominal: float):
    first, *others = estimate()["parameters"]
    offset = {**first, "name": "steering_offset", "unit": "rad", "nominal": nominal, "size": 1.0}
    record = read({**alone(), "parameters": [offset, *others], "paths": []})
    assert estimate_rows(record)[0][-1] == "-"
    assert "steering offset" not in section(record.plain(), "Summary").paragraphs[0]


def test_doubts_of_single_estimates_are_said_first():
    text = "track is -83.0 mm, and no robot of this kind has that: look at the columns"
    record = read({**estimate(), "doubts": [{"parameter": "track", "name": "sign", "message": text}]})
    assert warnings(record)[0].startswith("Track is")
    assert "83.0 mm, and no robot of this kind" in estimate_lines(record)[0]
    assert sum("no robot of this kind" in line for line in estimate_lines(record)) == 1
    notices = section(record.plain(), "Summary").notices
    assert notices[0] == warnings(record)[0]


def test_a_doubt_that_asks_ends_as_a_question():
    doubt = {"parameter": "", "name": "exact", "message": "position follows the model: is this the design?"}
    record = read({**estimate(), "doubts": [doubt]})
    assert warnings(record)[0] == "Position follows the model: is this the design?"


def test_bias_by_noise_of_the_inputs_stands_beside_the_number():
    first, *others = estimate()["parameters"]
    record = read({**estimate(), "parameters": [{**first, "bias": 0.0012, "input_noise": 0.3}, *others]})
    assert record.diluted == ()
    assert len(estimate_rows(record)[0]) == 6
    doubt = {"parameter": first["name"], "name": "input_noise", "message": "may be too large by up to 1.2 mm"}
    record = read({**record.plain(), "doubts": [doubt]})
    assert [row[-1] for row in estimate_rows(record)] == ["+1.2", *[""] * len(others)]
    (brief,) = section(record.plain(), "Summary").tables
    assert [row[-1] for row in brief.cells] == ["+1.2 mm", *[""] * len(others)]
