"""The founding paper's real experiment in simulation: which drive calibrates a robot that slips best.

A simulated robot drives along the optimal drive of every model and along everyday paths; every model is
calibrated from each drive alone and predicts, by its encoders, where other drives end.
"""

from oed.trial.candidates import trial_flaws
from oed.trial.options import Trial
from oed.trial.run import require_ready, run_trial

__all__ = ["Trial", "require_ready", "run_trial", "trial_flaws"]
