from .departures import leaving as leaving
from .robust import Robust as Robust
from .uncertainty import Uncertainty as Uncertainty
