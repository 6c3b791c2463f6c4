"""Figures of experiments with systems: what they draw, and their bands against an integration of our own."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
import sample_systems
from sample_systems import FISHING, HOUR, STARTS, WARMTHS
from scipy.integrate import solve_ivp
from shown_in import column, section

from oed.records.record import Record
from oed.report.figures import spec
from oed.report.parts.section import Picture

NOMINAL = np.array([1.0, 1.0, 0.9, 1.0]) / HOUR
"""Birth, loss, gain and death [1/s]."""
Array = npt.NDArray[np.float64]


def picture(record: Record, title: str, name: str) -> Picture:
    return next(one for one in section(record, title).figures if one.name == name)


def lines(panel: spec.Panel) -> list[spec.Line]:
    """Lines that are no marks."""
    return [one for one in panel.parts if isinstance(one, spec.Line) and "marker" not in one.look]


def marks(panel: spec.Panel) -> list[spec.Line]:
    return [one for one in panel.parts if isinstance(one, spec.Line) and "marker" in one.look]


def fills(panel: spec.Panel) -> list[tuple[Array, Array, Array]]:
    called = [one for one in panel.parts if isinstance(one, spec.Call) and one.method == "fill_between"]
    return [tuple(np.asarray(part) for part in one.arguments) for one in called]


def followed(values: Array, trial: int, places: int) -> Array:
    """Prey and predators (24 places + 1, 2, ...) of a trial with these parameters (4, ...)."""
    birth, loss, gain, death = values
    warmth, shape = WARMTHS[trial], (2, *values.shape[1:])
    rows = [np.multiply.outer(STARTS[trial], np.ones(values.shape[1:]))]
    for fishing in FISHING:

        def rates(_: float, state: Array, fishing: float = fishing) -> Array:
            prey, predators = state.reshape(shape)
            return np.ravel(
                [
                    (birth * warmth - loss * predators - 0.4 * fishing) * prey,
                    (gain * prey - death * warmth - 0.2 * fishing) * predators,
                ]
            )

        period = HOUR / 2
        times = np.linspace(0.0, period, places + 1)
        found = solve_ivp(
            rates, (0.0, period), rows[-1].ravel(), t_eval=times, method="DOP853", rtol=1e-11, atol=1e-13
        )
        rows.extend(found.y.T[1:].reshape(-1, *shape))
    return np.array(rows)


@cache
def slopes(trial: int, places: int) -> Array:
    """Derivatives (n, 2, 4) of the states by the parameters, as central differences."""
    steps = 1e-4 * np.diag(NOMINAL)
    found = followed(NOMINAL[:, None] + np.hstack([steps, -steps]), trial, places)
    return (found[..., :4] - found[..., 4:]) / (2e-4 * NOMINAL)


@pytest.mark.slow
@pytest.mark.parametrize("trial", [0, 1])
def test_bands_of_states_and_readings_are_what_estimates_leave_open(trial: int):
    """S Sigma S' along the design, S by an integration of our own; as shown, in the study's units."""
    record = sample_systems.ponds()
    best = record.best
    assert best is not None
    covariance = np.array(best.covariances[0].covariance, dtype=float)
    panel = picture(record, "What happens", "states").figure.panels[0]
    assert (panel.y.title, panel.x.label) == ("predators", "time [h]")
    times, low, high = fills(panel)[trial]
    places = (len(times) - 1) // 24
    by = slopes(trial, places)
    middle = followed(NOMINAL, trial, places)
    spread = np.sqrt(np.einsum("nsa,ab,nsb->ns", by, covariance, by))
    np.testing.assert_allclose(times, np.linspace(0.0, 12.0, len(times)), atol=1e-9)
    np.testing.assert_allclose((low + high) / 2, middle[:, 1], rtol=1e-5)
    np.testing.assert_allclose((high - low) / 2, spread[:, 1], rtol=1e-3, atol=1e-4 * spread.max())
    # The catch is what is fished of the predators, in 1/h.
    caught = picture(record, "What happens", "readings").figure.panels[1]
    fished = np.append(np.repeat(FISHING, places), FISHING[-1]) * HOUR
    _, low, high = fills(caught)[trial]
    np.testing.assert_allclose((high - low) / 2, fished * spread[:, 1], rtol=1e-3, atol=1e-4 * spread.max())
    assert caught.y.label == "catch [1/h]"


@pytest.mark.slow
def test_readings_are_marked_where_they_are_taken_with_their_noise():
    """At every sample of both trials."""
    panel = picture(sample_systems.ponds(), "What happens", "readings").figure.panels[0]
    first, second = marks(panel)
    np.testing.assert_allclose(first.x, np.linspace(0.0, 12.0, 25), atol=1e-12)
    bars = [one for one in panel.parts if isinstance(one, spec.Call) and one.method == "vlines"]
    _, low, high = bars[1].arguments
    np.testing.assert_allclose(high - low, 2 * 0.02)
    np.testing.assert_allclose((high + low) / 2, second.y)
    np.testing.assert_allclose(second.y, followed(NOMINAL, 1, 1)[:, 0], rtol=1e-5)


@pytest.mark.slow
def test_sensitivities_are_scaled_by_the_parameters():
    """A panel for each reading and trial, a line for each parameter."""
    panels = picture(sample_systems.ponds(), "Sensitivity of the readings", "sensitivities").figure.panels
    titles = ["prey seen, trial 1", "prey seen, trial 2", "catch, trial 1", "catch, trial 2"]
    assert [one.title for one in panels] == titles
    drawn = lines(panels[1])
    places = (len(drawn[0].x) - 1) // 24
    scaled = slopes(1, places)[:, 0, :] * NOMINAL
    for place, line in enumerate(drawn):
        np.testing.assert_allclose(line.y, scaled[:, place], rtol=1e-3, atol=1e-4 * np.abs(scaled).max())


@pytest.mark.slow
def test_the_first_screen_has_the_inputs_that_change_and_lists_what_does_not():
    """Steps between their limits, over time as the study gives it; warmth and starts in a table."""
    record = sample_systems.ponds()
    made = section(record, "Summary")
    assert made.first
    (panel,) = made.figures[0].figure.panels
    assert (panel.y.label, panel.x.label) == ("fishing [1/h]", "time [h]")
    first, other = lines(panel)
    assert first.look["drawstyle"] == "steps-post"
    for one in (first, other):
        np.testing.assert_allclose(one.y[:-1], FISHING * HOUR)
    np.testing.assert_allclose(first.x, np.linspace(0.0, 12.0, 25))
    assert [one.label for one in made.figures[0].figure.legend.keys] == ["trial 1", "trial 2"]
    levels = [one.arguments[0] for one in panel.parts if isinstance(one, spec.Call)]
    np.testing.assert_allclose(levels, [0.0, 1.0])
    trials = made.tables[1]
    np.testing.assert_allclose(np.array(column(trials, "initial prey"), dtype=float), [1.0, 0.5])
    np.testing.assert_allclose(np.array(column(trials, "warmth"), dtype=float), WARMTHS)


@pytest.mark.slow
def test_rates_are_drawn_where_they_are_limited():
    """In the unit of the limit; inputs without one are left out."""
    (one,) = section(sample_systems.ponds(), "How fast inputs change").figures
    (panel,) = one.figure.panels
    assert panel.y.unit == "1/h/h"
    assert panel.x.label == "time [h], trials one after the other"
    np.testing.assert_allclose(np.nanmax(lines(panel)[0].y), 2.0)


def test_a_response_is_drawn_over_its_input():
    """The curve, the settings on it, and a band of what they leave open, by derivatives written out."""
    record = sample_systems.reactions()
    best = record.best
    assert best is not None
    covariance = np.array(best.covariances[0].covariance, dtype=float)
    (panel,) = section(record, "Summary").figures[0].figure.panels
    assert panel.x.label == "t [min]"
    over, low, high = fills(panel)[0]
    k1, k2, t = 0.7 / 60, 0.2 / 60, 60 * over

    def read(k1: float, k2: float) -> Array:
        return np.asarray(k1 / (k1 - k2) * (np.exp(-k2 * t) - np.exp(-k1 * t)))

    step = 1e-5
    by = np.column_stack(
        [
            (read(k1 * (1 + step), k2) - read(k1 * (1 - step), k2)) / (2 * step * k1),
            (read(k1, k2 * (1 + step)) - read(k1, k2 * (1 - step))) / (2 * step * k2),
        ]
    )
    spread = np.sqrt(np.einsum("na,ab,nb->n", by, covariance, by))
    np.testing.assert_allclose((low + high) / 2, read(k1, k2), atol=1e-9)
    np.testing.assert_allclose((high - low) / 2, spread, rtol=1e-5, atol=1e-9)
    assert (over[0], over[-1]) == pytest.approx((0.0, 20.0))
    (dots,) = marks(panel)
    np.testing.assert_allclose(dots.x, np.array(sample_systems.TIMES) / 60)
    np.testing.assert_allclose(dots.y, np.interp(dots.x, over, read(k1, k2)), rtol=1e-3)


@pytest.mark.slow
def test_settings_of_two_inputs_are_dots_in_their_plane():
    """Those that are made twice are one dot that says so."""
    made = section(sample_systems.gas(), "Summary")
    (panel,) = made.figures[0].figure.panels
    assert (panel.x.label, panel.y.label) == ("pressure [bar]", "temperature [K]")
    (dots,) = marks(panel)
    np.testing.assert_allclose(np.column_stack([dots.x, dots.y]), [[1, 280], [10, 340]])
    assert [one.text for one in panel.parts if isinstance(one, spec.Note)] == ["2 ×"]
    np.testing.assert_allclose(np.array(column(made.tables[1], "pressure"), dtype=float), [1.0, 1.0, 10.0])


@pytest.mark.slow
def test_weights_of_settings_stand_over_the_input():
    """Not over numbers of settings, where there is one input."""
    record = sample_systems.parabola()
    assert section(record, "Summary").paragraphs[0] == "3 of 21 settings."
    (weights, _) = picture(record, "Which readings are taken", "weights").figure.panels
    assert weights.x.label == "x"
    (dots,) = marks(weights)
    np.testing.assert_allclose(dots.x, [-1.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(dots.y, [0.2, 0.6, 0.2])


@pytest.mark.slow
def test_trials_that_are_chosen_stand_side_by_side():
    """A stem for each trial, by its number; only those that are made are listed and drawn."""
    record = sample_systems.trials()
    best = record.best
    assert best is not None
    assert best.selection is not None
    weights = {one.run + 1: one.weight for one in best.selection.readings if one.weight > 0}
    assert sum(weights.values()) == pytest.approx(4.0)
    made = section(record, "Summary")
    assert made.paragraphs[0] == f"{len(weights)} of 4 trials of 120 min."
    assert column(made.tables[1], "trial") == [str(one) for one in weights]
    flows = dict(zip((1, 2, 3, 4), (0.0, 0.0, 1.0, 1.0), strict=True))
    np.testing.assert_allclose(
        np.array(column(made.tables[1], "flow"), dtype=float), [flows[one] for one in weights], atol=1e-12
    )
    part = section(record, "Which trials are taken")
    assert part.paragraphs[0] == f"Of 4 possible trials {len(weights)} are taken."
    (stems, _) = part.figures[0].figure.panels
    assert stems.x.label == "trial"
    (dots,) = marks(stems)
    np.testing.assert_allclose(dots.x, list(weights))
    np.testing.assert_allclose(dots.y, list(weights.values()))
    drawn = picture(record, "What happens", "readings").figure
    names = [f"trial {one}" for one in weights]
    assert [one.label for one in drawn.legend.keys][: len(names)] == names
