"""Known tracks, and what the core reports of a flight along them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import pdist

from star_core import AgentPhase, Array, Corrected, Event, Fence, Obstacle, Tick, Truth, World
from star_core.geometry.neighbours import Pairs
from star_core.messages.state import Goals, Paths, Plan, Setpoint
from star_core.messages.telemetry import Telemetry
from star_core.records.summary import FlightSummary, event_record
from star_core.testing import estimate, health, scene

PERIOD = 0.05  # s, of the scene
FLYING, LANDING = AgentPhase.FLYING, AgentPhase.LANDING
PILLAR = Obstacle("pillar", (((1.0, -1.0), (2.0, -1.0), (2.0, 1.0), (1.0, 1.0)),), (0.0, 2.0))


def tick(time: float, estimated_position: Any, truth: Any, phase: Sequence[AgentPhase]) -> Tick:
    """A tick of which only what is measured means anything."""
    position = np.array(estimated_position, np.float64)
    n = len(position)
    none = np.zeros(n, np.bool_)
    nothing = Setpoint(np.zeros((n, 3)), np.zeros(n), none)
    attitude = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    now = estimate(position, time=time)
    return Tick(
        time=time,
        telemetry=Telemetry(
            time, position, now.velocity, attitude, now.yaw, np.zeros(n, np.int64), now.yaw
        ),
        estimate=now,
        health=replace(health(n), phase=np.array(phase)),
        goals=Goals.none(n),
        plan=Plan(nothing, Paths(np.zeros(0, np.int64), np.zeros((0, 3))), none),
        sent=nothing,
        truth=None if truth is None else Truth(time, np.array(truth), now.velocity, attitude),
        doing="",
        corrected=Corrected(none, none, none, none),
    )


def measured(
    truth: Any,
    *,
    estimates: Any = None,
    obstacles: tuple[Obstacle, ...] = (),
    ground_truth: bool = True,
) -> dict[str, Any]:
    """The summary of a flight of ticks 0.05 s apart.

    Args:
        truth: (T, N, 3) where the agents are, m.
        estimates: (T, N, 3) where they are believed to be, m; where they are if not given.
        obstacles: In the room.
        ground_truth: Whether the truth is known.
    """
    track = np.array(truth, np.float64)
    t, n, _ = track.shape
    room = World("room", Fence((-99.0, -99.0, -99.0), (99.0, 99.0, 99.0)), obstacles)
    furnished = replace(scene(n), world=room)
    meter = FlightSummary(furnished)
    for k in range(t):
        where = track[k] if estimates is None else np.array(estimates)[k]
        now = tick(k * PERIOD, where, track[k] if ground_truth else None, [FLYING] * n)
        add(meter, now)
    return summed(meter)


def add(meter: FlightSummary, now: Tick) -> None:
    meter.add(now, Pairs.of(now.estimate.position, meter.contacts.reach))


def summed(meter: FlightSummary, wall_time: float = 2.0) -> dict[str, Any]:
    """The summary of what was measured in some time by the clock on the wall, s."""
    return meter.summary(
        mission="m",
        outcome="completed",
        reason="",
        wall_time=wall_time,
        took={},
    )


def apart(*distances: float) -> list[list[list[float]]]:
    """Two agents that are so far from each other, tick after tick."""
    return [[[0.0, 0.0, 1.0], [0.0, distance, 1.0]] for distance in distances]


# Separation and collisions


def test_the_separation_is_the_least_of_the_flight() -> None:
    assert measured(apart(2.0, 0.7, 1.5))["min_separation_m"] == pytest.approx(0.7)


def test_one_agent_is_apart_from_no_agent() -> None:
    summary = measured([[[0, 0, 1]], [[1, 0, 1]]])
    assert summary["min_separation_m"] is None
    assert summary["collisions"]["agent_agent"] == 0


@pytest.mark.parametrize(("distance", "collisions"), [(0.1199, 1), (0.12, 0), (0.13, 0)])
def test_two_agents_collide_nearer_than_twelve_centimetres(
    distance: float, collisions: int
) -> None:
    assert measured(apart(1.0, distance))["collisions"]["agent_agent"] == collisions


def test_a_collision_lasts_until_the_agents_part() -> None:
    summary = measured(apart(1.0, 0.1, 0.05, 0.1, 0.5, 0.1, 0.1))
    assert summary["collisions"]["agent_agent"] == 2


def test_each_pair_collides_by_itself() -> None:
    three = [[[0.0, 0.0, 1.0], [0.1, 0.0, 1.0], [0.05, 0.05, 1.0]]]
    assert measured(three)["collisions"]["agent_agent"] == 3


@pytest.mark.parametrize("n", [3, 70])
def test_a_collision_goes_on_though_another_agent_is_nowhere(n: int) -> None:
    line = np.zeros((n, 3))
    line[:, 1] = np.arange(n)
    line[-1] = line[-2] + [0.05, 0.0, 0.0]
    gap = line.copy()
    gap[0] = np.nan
    summary = measured([line, gap, line], ground_truth=False)
    assert summary["collisions"]["agent_agent"] == 1


def test_separation_is_of_the_estimate_without_ground_truth() -> None:
    summary = measured(apart(2.0), estimates=apart(1.0), ground_truth=False)
    assert summary["min_separation_m"] == pytest.approx(1.0)
    assert measured(apart(2.0), estimates=apart(0.01))["min_separation_m"] == pytest.approx(2.0)


def clouds(n: int) -> st.SearchStrategy[Array]:
    seeds = st.integers(0, 2**32 - 1)
    return seeds.map(lambda seed: np.random.default_rng(seed).uniform(0, 1.2, (n, 3)))


@pytest.mark.parametrize("n", [2, 63, 64, 150])
@settings(max_examples=20)
@given(data=st.data())
def test_separation_and_collisions_are_those_of_all_pairs(n: int, data: st.DataObject) -> None:
    cloud = data.draw(clouds(n))
    distances = pdist(cloud)
    summary = measured([cloud])
    assert summary["min_separation_m"] == pytest.approx(distances.min())
    assert summary["collisions"]["agent_agent"] == (distances < 0.12).sum()


@pytest.mark.parametrize("n", [63, 64])
def test_pairs_at_the_contact_distance_do_not_collide(n: int) -> None:
    line = np.zeros((n, 3))
    line[:, 1] = np.arange(n)
    line[1] = [0.05, 0.0, 0.0]  # 0.05 m from the first
    line[3] = line[2] + [0.12, 0.0, 0.0]
    assert measured([line])["collisions"]["agent_agent"] == 1


def test_unlocated_agents_are_near_no_agent_in_large_swarms() -> None:
    line = np.zeros((70, 3))
    line[:, 1] = 2.0 * np.arange(70)
    line[3:5] = np.nan
    summary = measured([line], ground_truth=False)
    assert summary["min_separation_m"] == pytest.approx(2.0)
    assert summary["collisions"]["agent_agent"] == 0


# Obstacles


def test_the_clearance_is_the_least_distance_from_an_obstacle() -> None:
    summary = measured([[[0.0, 0.0, 1.0]], [[0.4, 0.0, 1.0]]], obstacles=(PILLAR,))
    assert summary["min_clearance_m"] == pytest.approx(0.6)


def test_there_is_no_clearance_without_obstacles() -> None:
    assert measured([[[0.0, 0.0, 1.0]]])["min_clearance_m"] is None


@pytest.mark.parametrize(("x", "collisions"), [(0.941, 1), (0.939, 0), (1.5, 1)])
def test_an_agent_hits_an_obstacle_nearer_than_six_centimetres(x: float, collisions: int) -> None:
    summary = measured([[[0.0, 0.0, 1.0]], [[x, 0.0, 1.0]]], obstacles=(PILLAR,))
    assert summary["collisions"] == {"agent_agent": 0, "agent_obstacle": collisions}


def test_an_agent_hits_an_obstacle_again_once_it_was_clear() -> None:
    track = [[[x, 0.0, 1.0]] for x in (0.0, 0.98, 0.99, 0.5, 0.98)]
    assert measured(track, obstacles=(PILLAR,))["collisions"]["agent_obstacle"] == 2


def test_clearance_is_that_of_the_agents_that_are_somewhere() -> None:
    summary = measured([[[0.0, 0.0, 1.0], [np.nan] * 3]], ground_truth=False, obstacles=(PILLAR,))
    assert summary["min_clearance_m"] == pytest.approx(1.0)


# The rest


def test_the_flight_lasts_from_its_first_tick_to_its_last() -> None:
    summary = measured(apart(*[1.0] * 41))
    assert summary["flight_time_s"] == pytest.approx(2.0)
    assert summary["realtime_factor"] == pytest.approx(1.0)  # in 2 s of the clock on the wall


def test_the_time_before_the_first_tick_is_no_flight() -> None:
    meter = FlightSummary(scene(1))
    for time in (5.0, 7.5):
        add(meter, tick(time, [[0, 0, 1]], None, [FLYING]))
    summary = summed(meter)
    assert summary["flight_time_s"] == pytest.approx(2.5)


def test_events_are_kept_in_order_and_without_what_they_lack() -> None:
    events = [Event(0.5, "failure", "cf1 is lost", "cf1"), Event(0.6, "step", "done")]
    assert [*map(event_record, events)] == [
        {"time": 0.5, "kind": "failure", "text": "cf1 is lost", "agent": "cf1"},
        {"time": 0.6, "kind": "step", "text": "done"},
    ]


@pytest.mark.parametrize("n", [1, 2, 64])
def test_a_summary_is_plain_json(n: int) -> None:
    track = np.zeros((3, n, 3))
    track[..., 1] = np.arange(n)
    summary = measured(track, obstacles=(PILLAR,))
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def test_a_flight_without_a_tick_has_a_summary_too() -> None:
    meter = FlightSummary(scene(2))
    summary = summed(meter, wall_time=0.0)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["realtime_factor"] is None
