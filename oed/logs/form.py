"""What every form of log has in common: the study's key `log`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from oed.foundation.component import Component
from oed.foundation.errors import Flaw
from oed.foundation.quantities import Duration
from oed.kernel.dynamics.system import System
from oed.logs.log import Log

Repeats = Literal["keep", "drop"]
"""What is done with poses that repeat the one before while the wheels turn, as a slower sensor's do."""
BAG_ENDINGS = (".mcap", ".db3", ".bag")
"""By which a file is known to be a ROS bag."""


class LogForm(Component, ABC):
    """How a robot's logs are read.

    Attributes:
        gap: longer steps in time are gaps [s]; five median steps by default.
        skip_stationary: whether to cut off standing before and after the drive, but for a second.
    """

    kind: str
    gap: Annotated[Duration, Field(gt=0)] | None = None
    skip_stationary: bool = False

    @abstractmethod
    def read(self, file: Path, model: System) -> list[Log]:
        """The drives in a file.

        Raises:
            LogError: every mistake in the file, each with its line.
        """

    @abstractmethod
    def flaws(self, model: System) -> list[Flaw]:
        """What in this form does not fit the robot."""


def is_bag(file: Path) -> bool:
    """Whether a path is a ROS bag's, by its ending or its metadata."""
    return file.suffix.lower() in BAG_ENDINGS or (file / "metadata.yaml").is_file()
