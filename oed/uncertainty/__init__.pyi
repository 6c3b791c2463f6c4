from .departures import violation_probability as violation_probability
from .robust import Robust as Robust
from .uncertainty import Uncertainty as Uncertainty
