"""Collisions and close approaches along known tracks, and what they do to a mission."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import AgentPhase, Array, Estimate, Event, Obstacle, Scene, Tick, Truth
from star_core.geometry.neighbours import Pairs
from star_core.safety.contacts import Contacts
from star_core.testing import estimate, scene
from tests.core.conftest import Lab
from tests.core.records.test_summary import PERIOD, PILLAR, tick

FLYING, GROUNDED = AgentPhase.FLYING, AgentPhase.GROUNDED
SEPARATION = 0.2  # m, the scene's limit


def followed(
    track: Any,
    *,
    obstacles: tuple[Obstacle, ...] = (),
    phase: AgentPhase = FLYING,
    truth: bool = True,
) -> tuple[Contacts, list[list[Event]]]:
    """The contacts of (T, N, 3) positions, m, with the incidents of each tick and of the end."""
    positions = np.array(track, np.float64)
    n = positions.shape[1]
    contacts = Contacts(furnished(n, obstacles))
    incidents = [
        update(contacts, moment(k, positions, phase, truth=truth)) for k in range(len(positions))
    ]
    return contacts, [*incidents, contacts.finish()]


def update(contacts: Contacts, tick: Tick) -> list[Event]:
    return contacts.update(tick, Pairs.of(tick.estimate.position, contacts.reach))


def furnished(n: int, obstacles: tuple[Obstacle, ...]) -> Scene:
    empty = scene(n)
    return replace(empty, world=replace(empty.world, obstacles=obstacles))


def moment(k: int, positions: Array, phase: AgentPhase, *, truth: bool) -> Tick:
    """Tick `k`, with velocities as differences of the positions."""
    position, before = positions[k], positions[max(0, k - 1)]
    n = len(position)
    velocity = (position - before) / PERIOD
    now = replace(tick(k * PERIOD, position, None, [phase] * n), estimate=at(position, velocity, k))
    attitude = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    return replace(now, truth=Truth(now.time, position, velocity, attitude)) if truth else now


def at(position: Array, velocity: Array, k: int) -> Estimate:
    return estimate(position, velocity=velocity, time=k * PERIOD)


def pair(*distances: float) -> list[list[list[float]]]:
    """Two agents at these distances from each other along x, m, the first at the origin."""
    return [[[0.0, 0.0, 1.0], [distance, 0.0, 1.0]] for distance in distances]


def test_collisions_report_agents_position_time_and_speed() -> None:
    contacts, incidents = followed(pair(0.5, 0.3, 0.1))
    ((incident,),) = [events for events in incidents if events]
    assert incident.kind == "collision"
    assert incident.details == {
        "agents": ["cf1", "cf2"],
        "time_s": 2 * PERIOD,
        "position_m": pytest.approx([0.05, 0.0, 1.0]),
        "relative_speed_m_s": pytest.approx(0.2 / PERIOD),
        "from": "ground_truth",
    }
    assert incident.text == ("cf1 and cf2 collided at [0.05, 0.00, 1.00], relative speed 4.00 m/s")
    assert (contacts.agent_agent, contacts.agent_obstacle) == (1, 0)


def test_a_collision_with_an_obstacle_names_the_obstacle() -> None:
    contacts, incidents = followed([[[0.5, 0, 1]], [[0.96, 0, 1]]], obstacles=(PILLAR,))
    ((incident,),) = [events for events in incidents if events]
    assert (incident.details or {})["agents"] == ["cf1"]
    assert (incident.details or {})["obstacle"] == "pillar"
    assert "cf1 and obstacle 'pillar' collided at [0.96, 0.00, 1.00]" in incident.text
    assert (contacts.agent_agent, contacts.agent_obstacle) == (0, 1)


def test_a_contact_that_lasts_is_one_collision() -> None:
    _, incidents = followed(pair(0.1, 0.11, 0.1, 0.5, 0.1))
    assert [len(events) for events in incidents] == [1, 0, 0, 0, 1, 0]


def test_close_approaches_report_their_smallest_distance_once() -> None:
    _, incidents = followed(pair(0.5, 0.19, 0.15, 0.17, 0.3, 0.5))
    assert [len(events) for events in incidents] == [0, 0, 0, 0, 1, 0, 0]
    (incident,) = incidents[4]
    assert incident.kind == "close_approach"
    assert (incident.details or {})["distance_m"] == pytest.approx(0.15)
    assert (incident.details or {})["time_s"] == pytest.approx(2 * PERIOD)
    assert (incident.details or {})["agents"] == ["cf1", "cf2"]
    assert f"closer than limits.separation ({SEPARATION:g} m) and" in incident.text


def test_close_approaches_use_an_ellipsoid_and_report_distance() -> None:
    def over(aside: float, height: float) -> list[Event]:
        track = [[[0, 0, 1], [2, 0, 1]], [[0, 0, 1], [aside, 0, 1 + height]]]
        contacts, incidents = followed(track)
        assert contacts.separation == pytest.approx(math.hypot(aside, height))
        return incidents[-1]

    assert [incident.kind for incident in over(0.0, 0.59)] == ["close_approach"]
    (inside,) = over(0.14, 0.42)  # of the semi-axes: 0.7 each
    assert (inside.details or {})["distance_m"] == pytest.approx(math.hypot(0.14, 0.42))
    assert not over(0.0, 0.61)
    assert not over(0.15, 0.45)


def test_unfinished_close_approaches_are_reported_at_the_end() -> None:
    _, incidents = followed(pair(0.5, 0.15))
    assert [len(events) for events in incidents] == [0, 0, 1]


def test_distances_around_the_limit_are_one_close_approach() -> None:
    _, incidents = followed(pair(0.5, 0.199, 0.201, 0.199, 0.201, 0.5))
    assert [len(events) for events in incidents] == [0, 0, 0, 0, 0, 1, 0]


@pytest.mark.parametrize("distances", [(0.5, 0.15, 0.1, 0.15, 0.5), (0.1, 0.5), (0.5, 0.1)])
def test_a_collision_is_not_a_close_approach_as_well(distances: Sequence[float]) -> None:
    _, incidents = followed(pair(*distances))
    assert [event.kind for events in incidents for event in events] == ["collision"]


def test_grounded_agents_make_no_close_approaches() -> None:
    _, incidents = followed(pair(0.15, 0.15), phase=GROUNDED)
    assert not any(incidents)


def test_without_ground_truth_incidents_are_marked_as_estimated() -> None:
    contacts, incidents = followed(pair(0.5, 0.1), truth=False)
    (note,), (incident,) = [events for events in incidents if events]
    assert note.kind == "no_truth"
    assert (incident.details or {})["from"] == "estimate"
    assert incident.text.endswith(" (estimated positions)")
    assert contacts.source == "estimate"


def test_distance_source_is_mixed_if_truth_is_intermittent() -> None:
    contacts = Contacts(scene(2))
    positions = np.array(pair(0.5, 0.5))
    update(contacts, moment(0, positions, FLYING, truth=True))
    assert contacts.source == "ground_truth"
    update(contacts, moment(1, positions, FLYING, truth=False))
    assert contacts.source == "mixed"


def test_ticks_on_the_ground_do_not_affect_the_distance_source() -> None:
    contacts = Contacts(scene(2))
    positions = np.array(pair(0.5, 0.5))
    update(contacts, moment(0, positions, GROUNDED, truth=False))
    update(contacts, moment(1, positions, FLYING, truth=True))
    assert contacts.source == "ground_truth"


UNGUARDED = "limits: {separation: 0}\n"
COLLIDE = """
  - climb: {}
  - visit: {to: [0, 0.5, 1]}
  - visit: {agents: cf1, to: [0, -1, 1]}
  - descend: {}
"""


def test_a_flight_with_a_collision_fails(lab: Lab) -> None:
    summary = lab.fly(COLLIDE, more=UNGUARDED)
    assert summary["collisions"]["agent_agent"] == 1
    assert (summary["outcome"], summary["reason"]) == ("failed", "1 collision")
    (event,) = [event for event in lab.events if event.kind == "collision"]
    assert event.details is not None
    assert event.details["agents"] == ["cf1", "cf2"]
    assert summary["distances_from"] == "ground_truth"


def test_a_mission_may_state_that_collisions_are_only_recorded(lab: Lab) -> None:
    summary = lab.fly(COLLIDE, more=UNGUARDED + "collisions: record\n")
    assert summary["collisions"]["agent_agent"] == 1
    assert (summary["outcome"], summary["reason"]) == ("completed", "")
    assert lab.said("collision")


def test_a_flight_without_ground_truth_reports_it_once(lab: Lab) -> None:
    lab.spoil("transport", "truth", lambda _right: None)
    summary = lab.fly(COLLIDE, more=UNGUARDED)
    assert lab.said("no_truth") == [
        "no ground truth: separation and collisions are computed from estimated positions"
    ]
    assert summary["distances_from"] == "estimate"
    assert summary["reason"] == "1 collision (estimated positions)"
