"""Search for the largest excess of limits between the points at which a drive is scored."""

from oed.kernel.between.excess import exceeded as exceeded
from oed.kernel.between.periods import Periods as Periods
from oed.kernel.between.periods import periods_of as periods_of
from oed.kernel.between.search import GAP as GAP
from oed.kernel.between.search import ScoredDrive as ScoredDrive
from oed.kernel.between.search import change_per_metre as change_per_metre
from oed.kernel.between.search import excess_of as excess_of
from oed.kernel.between.search import largest as largest
from oed.kernel.between.search import most_exceeded as most_exceeded
