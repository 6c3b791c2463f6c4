"""The words of a domain: what they replace, and what they leave alone."""

from __future__ import annotations

from oed.foundation.vocabulary import Vocabulary, speaking, spoken

OWN = Vocabulary({"a drive": "an experiment", "drive": "experiment", "robot": "system"}, ("drive gain", "a"))


def test_words_are_replaced_as_they_begin():
    assert OWN.said("A drive of the Robot; drives, driver") == "An experiment of the System; drives, driver"


def test_names_stay_even_where_they_are_articles():
    assert OWN.said("drive gain of a drive") == "drive gain of an experiment"


def test_it_holds_while_it_is_spoken():
    with speaking(OWN):
        assert spoken("no drive") == "no experiment"
    assert spoken("no drive") == "no drive"
