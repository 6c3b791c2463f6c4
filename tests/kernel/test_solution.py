"""A status is a sentence that says what to do."""

from __future__ import annotations

import pytest

from oed.kernel.solution import Solution, Status


@pytest.mark.parametrize("status", Status)
def test_every_status_says_what_it_means(status: Status):
    assert status.sentence.endswith(".")
    assert Solution("ipopt", "ipopt", None, None, status).message == status.sentence


def test_sentences_differ():
    assert len({status.sentence for status in Status}) == len(Status)


def test_detail_follows_the_sentence():
    solution = Solution("ipopt", "ipopt", None, None, Status.INFEASIBLE, detail="The box is too small.")
    assert solution.message == f"{Status.INFEASIBLE.sentence} The box is too small."


def test_only_designs_are_usable():
    useless = {Status.INFEASIBLE, Status.SINGULAR, Status.FAILED, Status.UNSCORED, Status.IMPOSSIBLE}
    assert {status for status in Status if not status.usable} == useless
