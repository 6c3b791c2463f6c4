"""Limits between the points at which a drive is looked at."""

from oed.between.excess import exceeded as exceeded
from oed.between.periods import Periods as Periods
from oed.between.periods import periods_of as periods_of
from oed.between.search import Sight as Sight
from oed.between.search import change_per_metre as change_per_metre
from oed.between.search import excess_of as excess_of
from oed.between.search import largest as largest
from oed.between.search import most_exceeded as most_exceeded
