"""Monitors report findings; the control loop acts on them."""

from __future__ import annotations

import numpy as np

from star_core.errors import PluginError
from star_core.plugin_support.guard import Strikes
from star_core.safety.monitors import Brake, PendingBrakes, TickState
from star_core.testing import scene
from star_core.testing.inputs import flight_telemetry


def test_all_agents_brake_in_the_tick_of_a_tolerated_failure() -> None:
    strikes, none = Strikes(3), np.zeros(1, np.bool_)
    state = TickState(flight_telemetry(scene(1), 0.0, none, none), np.zeros(1, np.int64), none)
    monitor = PendingBrakes(strikes)
    assert not list(monitor.check(state))
    strikes.begin_tick(in_flight=True)
    assert strikes.tolerates("planner 'mine'", PluginError("planner 'mine': raised"))
    assert list(monitor.check(state)) == [Brake()]
    strikes.drain()  # when the tick is recorded
    assert not list(monitor.check(state))


def test_all_agents_brake_where_an_earlier_stage_found_that() -> None:
    none = np.zeros(1, np.bool_)
    state = TickState(flight_telemetry(scene(1), 0.0, none, none), np.zeros(1, np.int64), none)
    state.brakes = True
    assert list(PendingBrakes(Strikes(3)).check(state)) == [Brake()]
