"""The table of all drones, and what it is named after."""

from __future__ import annotations

import numpy as np

from star_sim.drone import standing


def test_drones_stand_where_they_are_put_with_their_motors_off() -> None:
    drones = standing(np.array([[1.0, 2.0, 0.5]]), np.array([np.pi / 2]), 0.5)
    assert drones["position"].tolist() == [[1.0, 2.0, 0.5]]
    assert np.allclose(drones["attitude"], [[0, 0, 0.5**0.5, 0.5**0.5]])
    assert drones["voltage"] == 3.92
    assert not drones["thrust"].any()
