"""A drive's regressors as functions of the coefficients: what an estimator computes them from."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Places
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.dynamics.trajectory import Trajectory
from oed.robots.models.model import Model
from oed.robots.sensors.displacements import Displacements

COMPILED = ("_designs", "_position")
"""Functions that are kept."""


class Regressors:
    """Phi_theta and Phi_xy of one drive [Choi, eqs 10, 14] at coefficients that predict its headings."""

    def __init__(self, model: Model, measurement: Displacements, trajectory: Trajectory) -> None:
        """Keep the parts; functions are compiled when first used."""
        self.robot = model.by_coefficients
        self.trajectory = trajectory
        self._measurement = measurement
        self.nominal = np.array(self.robot.nominal)
        heading, *others = self.robot.coefficient_names
        self.names = {"heading": heading, "position": tuple(name for row in others for name in row)}

    @property
    def true(self) -> dict[str, Array]:
        """Nominal coefficients by regression."""
        columns = len(self.names["heading"])
        return {"heading": self.nominal[:columns], "position": self.nominal[columns:]}

    @cached_property
    def nominal_designs(self) -> dict[str, Array]:
        """W of each regression at the nominal coefficients: "heading" (P, q), "position" (2 P, q)."""
        heading, position = self._designs(self.nominal)
        return {"heading": np.array(heading), "position": np.array(position)}

    @cached_property
    def per_sample(self) -> Array:
        """Each sample's own rows x, y of Phi_xy at the nominal coefficients, (N, 2, q)."""
        single = self._measurement.model_copy(update={"segments": "samples"})
        rows = np.array(self._function(single)(self.nominal)[1])
        return rows.reshape(self.trajectory.samples, 2, -1)

    def predicted_positions(self, first_stage: Array) -> Array:
        """Phi_xy with the headings that estimates (R, q) of c11, c12 predict, (R, 2 P, q) [Choi, eq. 16]."""
        count = len(first_stage)
        columns = np.tile(self.nominal[:, None], count)
        columns[: first_stage.shape[1]] = first_stage.T
        stacked = np.array(self._position.map(count)(columns))
        return stacked.reshape(stacked.shape[0], count, -1).transpose(1, 0, 2)

    @property
    def edges(self) -> Places:
        """Sample indices (P + 1,) at which segments begin and end."""
        runs = self.trajectory.runs
        return self._measurement.segment_edges(self.trajectory.samples // runs, runs)

    @cached_property
    def directions(self) -> Array:
        """Heading in the middle of each period at the nominal coefficients, (N,) [rad]."""
        return np.array(ca.evalf(self._drive(ca.SX(ca.DM(self.nominal))).signals["direction"])).ravel()

    @cached_property
    def heading_effect(self) -> Array:
        """Derivative of Phi_xy c by the coefficients that its headings are predicted from, (2 P, q)."""
        columns = len(self.names["heading"])
        coefficients = ca.SX.sym("c", len(self.nominal))
        predicted = self._designs(coefficients)[1] @ ca.DM(self.nominal[columns:])
        slope = ca.jacobian(predicted, coefficients)[:, :columns]
        return np.array(ca.Function("effect", [coefficients], [ca.densify(slope)])(self.nominal))

    @cached_property
    def _position(self) -> ca.Function:
        coefficients = ca.SX.sym("c", len(self.nominal))
        return ca.Function("position", [coefficients], [self._designs(coefficients)[1]])

    @cached_property
    def _designs(self) -> ca.Function:
        return self._function(self._measurement)

    def _function(self, measurement: Displacements) -> ca.Function:
        coefficients = ca.SX.sym("c", len(self.nominal))
        both = measurement.model_copy(update={"regressor": "both"})
        blocks = both.blocks(self._drive(coefficients))
        return ca.Function("designs", [coefficients], [block.design_matrix for block in blocks])

    def _drive(self, coefficients: ca.SX) -> Drive:
        inputs = ca.SX(ca.DM(self.trajectory.inputs))
        return roll_out(
            self.robot,
            inputs=inputs,
            start=ca.SX(ca.DM(self.trajectory.start)),
            parameters=coefficients,
            period=ca.SX(self.trajectory.period),
            runs=self.trajectory.runs,
        )

    def __getstate__(self) -> dict[str, object]:
        """What workers need: compiled functions are made again there."""
        return {key: value for key, value in vars(self).items() if key not in COMPILED}
