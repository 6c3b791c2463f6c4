"""How parameters are estimated from logs: the study's key `calibration`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from oed.estimation.setup.alternatives import Alternative
from oed.estimation.setup.unknowns import PLACE, PlaceName
from oed.foundation.component import Component
from oed.foundation.quantities import Duration

Method = Literal["joint", "gls", "two_stage"]
Loss = Literal["linear", "soft_l1", "huber", "cauchy"]
CovarianceName = Literal["information", "sandwich", "bootstrap"]


class CalibrationOptions(Component):
    """Estimation from logs; the defaults suit a first look at any log.

    Attributes:
        method: joint (nonlinear least squares on all poses of each segment, its start unknown), gls (motion
            between the ends of windows, weighted by their correlated noise) or two_stage (the paper's: first
            the headings, then the positions, unweighted).
        segment: length of a segment or window [s]; "log" takes whole logs; auto takes the longest in which no
            drift shows, of windows 2 s.
        covariance: information (F^-1), sandwich, or moving-block bootstrap; auto takes F^-1 where whole logs
            are free of drift or there are too few parts to compare, the bootstrap else.
        block: length of the bootstrap's blocks and of the sandwich's correlations [s]; auto takes whole
            logs where there are eight or more, a fifth of each else.
        replicates: of the bootstrap.
        sensor_place: which coordinates of the pose sensor's place on the robot are nuisance parameters.
        clock_offset: whether the offset between the clocks of wheels and poses is estimated, for each file.
        noise: estimated from the residuals as sigma^2 = sigma0^2 + (k_v V)^2 + (k_w Omega)^2 at speed V and
            yaw rate Omega, each growth only where the likelihood leaves no doubt (that with Omega only
            where it shows from reading to reading as well); estimated as constant
            (where what grows is the model's error, not the sensor's), or as the measurement specifies.
        loss: of a residual in units of the noise; other than "linear" it bounds the influence of outliers.
        models: other robots, fitted to the same logs and compared with the study's own.
    """

    method: Method = "joint"
    segment: Annotated[Duration, Field(gt=0)] | Literal["auto", "log"] = "auto"
    covariance: CovarianceName | Literal["auto"] = "auto"
    block: Annotated[Duration, Field(gt=0)] | Literal["auto"] = "auto"
    replicates: Annotated[int, Field(ge=100, le=10_000_000)] = 2000
    sensor_place: tuple[PlaceName, ...] = PLACE
    clock_offset: bool = True
    noise: Literal["estimated", "constant", "stated"] = "estimated"
    loss: Loss = "linear"
    models: tuple[Alternative, ...] = ()

    @field_validator("models")
    @classmethod
    def _named_apart(cls, models: tuple[Alternative, ...]) -> tuple[Alternative, ...]:
        labels = [one.label for one in models]
        twice = sorted({label for label in labels if labels.count(label) > 1})
        if twice:
            raise ValueError(f"two models named {', '.join(twice)}; give each a `name` of its own")
        return models
