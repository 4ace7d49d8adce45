"""The avoider `none` changes nothing."""

from __future__ import annotations

import numpy as np

import star_none
from star_core import Setpoint
from star_core.testing import estimate, scene


def test_what_is_wanted_is_flown_whatever_is_in_the_way() -> None:
    (offer,) = star_none.star_avoiders()
    wish = Setpoint(np.array([[0.5, 0, 0], [-0.5, 0, 0]]), np.zeros(2), np.ones(2, np.bool_))
    now = estimate(np.array([[0.0, 0, 1], [0.3, 0, 1]]))
    assert offer.make(scene(2)).avoid(now, wish) is wish
