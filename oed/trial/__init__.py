"""The founding paper's real experiment in simulation: which drive calibrates a robot that slips best.

A simulated robot drives along the optimal drive of every model and along everyday paths; every model is
calibrated from each drive alone and predicts, by its encoders, where other drives end.
"""

from typing import TYPE_CHECKING

from oed.lazy import loader

if TYPE_CHECKING:
    from oed.trial.candidates import trial_flaws as trial_flaws
    from oed.trial.options import Trial as Trial
    from oed.trial.run import require_ready as require_ready
    from oed.trial.run import run_trial as run_trial

_HOMES = {
    "oed.trial.candidates": ("trial_flaws",),
    "oed.trial.options": ("Trial",),
    "oed.trial.run": (
        "require_ready",
        "run_trial",
    ),
}
__getattr__ = loader(__name__, _HOMES)

__all__ = ["Trial", "require_ready", "run_trial", "trial_flaws"]
