"""Grade a mission, for example a student's: ``pytest examples/test_grading.py``.

The fixture `fly` comes with STAR. It returns the record of a flight, as `star_core.read_run` does.
"""

import numpy as np
import pytest


@pytest.mark.parametrize("change", ["seed=3"])  # any number of changes, as of `--set`
def test_three_drones_fly_a_lap_apart_from_each_other(fly, change):
    run = fly("../missions/first_flight.yaml", change)
    assert run.summary["outcome"] == "completed", run.summary["reason"]
    assert run.summary["min_separation_m"] > 0.2
    assert run.summary["flight_time_s"] < 60
    height = run.arrays["truth_position"][:, :, 2]  # (ticks, agents), m
    assert np.all(height.max(axis=0) > 0.5), f"not in the air: {run.agents}"
