"""The founding paper's real experiment in simulation: which drive calibrates a robot that slips best.

A simulated robot drives along the optimal drive of every model and along baselines; every model is
calibrated from each drive alone and predicts, by its encoders, where other drives end.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
