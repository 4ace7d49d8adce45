"""Tests of the author of these plugins, with what `star_core.testing` offers."""

import numpy as np
import pytest

from star_core import ContractError, Setpoint, Status
from star_core.testing import check_avoider, estimate, health, scene
from star_gentle.avoider import Gentle
from star_gentle.nod import Nod


class Empty:
    """An avoider that loses its agents."""

    def avoid(self, estimate, wanted):
        return Setpoint(np.zeros((0, 3)), np.zeros(0), np.zeros(0, bool))


def test_gentle_keeps_the_contract():
    check_avoider(Gentle(0.5))


def test_an_avoider_that_loses_agents_breaks_the_contract():
    with pytest.raises(ContractError, match="has 0 rows, expected 3"):
        check_avoider(Empty())


def test_a_nod_ends_where_it_began():
    nod = Nod(scene(2), (1,), height=0.2)
    low, high = np.array([[0.0, 0, 1], [1, 0, 1]]), np.array([[0.0, 0, 1], [1, 0, 1.2]])
    nod.begin(estimate(low), health(2))
    statuses = [nod.step(estimate(where), health(2)).status for where in (low, high, high, low)]
    assert statuses == [*[Status.RUNNING] * 3, Status.SUCCESS]
