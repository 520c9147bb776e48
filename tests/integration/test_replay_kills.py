"""A replay service that is killed again and again loses and doubles nothing acknowledged."""

import pytest
from replay_kills import run


@pytest.mark.slow
def test_ten_kills_lose_nothing_and_double_nothing(tmp_path):
    outcome = run(10, 1, tmp_path / "replay")
    assert outcome.acknowledged > 10
    assert (outcome.lost, outcome.doubled, outcome.wrong, outcome.given_up) == (0, 0, 0, 0)
