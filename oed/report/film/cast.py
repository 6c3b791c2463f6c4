"""What a film shows: drives, run by run."""

from __future__ import annotations

from dataclasses import dataclass

from oed.records.stored.result import Result
from oed.report.figures.driven import Motion, motions_of
from oed.report.parts.reading import heading

PAUSE = 0.6
"""Rest between two runs [s of the film]."""


@dataclass(frozen=True)
class Cast:
    """A drive to be shown: its name with what is special about it, and its runs one after the other."""

    title: str
    runs: tuple[Motion, ...]

    @classmethod
    def of(cls, result: Result) -> Cast:
        """A result that has a drive."""
        return cls(heading(result), tuple(motions_of(result)))

    def length(self, speed: float) -> float:
        """How long the film of it plays, without the rest at its end [s]."""
        return sum(run.duration for run in self.runs) / speed + PAUSE * (len(self.runs) - 1)

    def moment(self, time: float, speed: float) -> tuple[int, float]:
        """Which run is shown at a time of the film [s], from 0, and how far it is [s of the robot]."""
        start = 0.0
        for number, run in enumerate(self.runs):
            end = start + run.duration / speed + PAUSE
            if time < end or number == len(self.runs) - 1:
                break
            start = end
        return number, min(max(0.0, time - start) * speed, run.duration)
