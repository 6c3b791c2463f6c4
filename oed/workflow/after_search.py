"""Steps that follow the searches of a run: the failure of one is recorded, and the results are kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from traceback import extract_tb
from typing import TypeVar

from oed.foundation.errors import OedError

Result = TypeVar("Result")


@dataclass
class Failures:
    """Steps of a run that failed after a search.

    Attributes:
        by_step: a sentence about each failure, by the name of the step.
    """

    by_step: dict[str, str] = field(default_factory=dict)

    @property
    def sentences(self) -> list[str]:
        """One sentence for every failed step."""
        return list(self.by_step.values())

    def attempt(self, step: str, work: Callable[[], Result], default: Result) -> Result:
        """Return the result of `work`, or `default` if it fails; an interrupt is passed on.

        Args:
            step: name of the work in a sentence, e.g. "bound".
            work: what is tried.
            default: result of a step that fails.
        """
        try:
            return work()
        # Not only errors raised on purpose: a defect in a later step must not cost the search its result.
        except Exception as error:
            self.by_step[step] = failure_sentence(step, error)
            return default


def failure_sentence(step: str, error: Exception) -> str:
    """Return a sentence that names the failed step and the reason.

    Args:
        step: name of the work in a sentence.
        error: raised by it.
    """
    if isinstance(error, OedError):
        return f"The {step} failed: {str(error).rstrip('.')}."
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    *_, frame = extract_tb(error.__traceback__)
    place = f"{Path(frame.filename).name}:{frame.lineno}"
    return f"The {step} failed by a defect of oed, not of your files ({reason}; {place})."
