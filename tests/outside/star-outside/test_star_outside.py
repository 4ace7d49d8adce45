"""A third party's own tests, with what `star_core.testing` gives them."""

import numpy as np
import pytest

from star_core import ContractError, Estimate, Setpoint, Status
from star_core.testing import check_avoider, estimate, health, scene
from star_outside.gentle import Gentle
from star_outside.nod import Nod


class Absent:
    """An avoider that loses its agents."""

    def avoid(self, _estimate: Estimate, _wanted: Setpoint) -> Setpoint:
        return Setpoint(np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.bool_))


def test_gentle_keeps_the_contract() -> None:
    check_avoider(Gentle(0.5))


def test_an_avoider_that_loses_agents_breaks_the_contract() -> None:
    with pytest.raises(ContractError, match="has 0 rows, expected 3"):
        check_avoider(Absent())


def test_a_nod_ends_where_it_began() -> None:
    nod = Nod(scene(2), (1,), height=0.2, times=1)
    low, high = np.array([[0.0, 0, 1], [1, 0, 1]]), np.array([[0.0, 0, 1], [1, 0, 1.2]])
    nod.begin(estimate(low), health(2))
    statuses = [nod.step(estimate(where), health(2)).status for where in (low, high, high, low)]
    assert statuses == [*[Status.RUNNING] * 3, Status.SUCCESS]
