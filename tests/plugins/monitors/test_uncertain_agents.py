"""Agents whose uncertainty leaves no room brake, return to where they were located, or land."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import Array, Goals, Limits, Obstacle, Setpoint
from star_core.testing import estimate, scene
from star_monitors.uncertain_agents import MAX_RETURNS, PARTING_TIME, WAITING_TIME, UncertainAgents

BOX = Obstacle("box2", (((1.0, -1.0), (2.0, -1.0), (2.0, 1.0), (1.0, 1.0)),), (0.0, 2.0))
GOAL = (0.8, 0.5, 1.0)
FAR, NEAR = (-0.5, 0.0, 1.0), (0.7, 0.0, 1.0)  # from the box
EAST, WEST = (0.3, 0.0, 0.0), (-0.3, 0.0, 0.0)  # m/s, towards the box and away from it


class Flight:
    """Agents near a box, with the events about them and what is made of their setpoints."""

    def __init__(self, n: int = 1, margin: float = 2.0) -> None:
        room = scene(n, limits=Limits(uncertainty_margin=margin))
        self.events: list[str] = []
        self.lands: list[str] = []
        self.goal = np.tile(GOAL, (n, 1))  # m, after the last tick
        self._agents = UncertainAgents(replace(room, world=replace(room.world, obstacles=(BOX,))))
        self._time = 0.0
        self._landing = np.zeros(n, np.bool_)

    def at(
        self,
        *position: tuple[float, ...],
        std: float,
        planned: tuple[Any, ...] = (EAST,),
        flown: tuple[Any, ...] | None = None,
        seconds: float = 0.05,
    ) -> list[bool]:
        """Be at some positions for a while; return which agents still fly as planned.

        Args:
            position: Of each agent, m.
            std: Standard deviation of the positions, m.
            planned: Their velocities, m/s.
            flown: Their velocities, m/s; at rest if None.
            seconds: Duration.
        """
        n = len(position)
        velocity: Array = np.array(planned)
        goals = Goals(
            *(np.tile(GOAL, (n, 1)), np.full((n, 3), 0.1), np.zeros(n), np.full(n, 0.5)),
            np.ones(n, np.bool_),
        )
        for _ in range(round(seconds / 0.05)):
            self._time += 0.05
            now = estimate(
                np.array(position),
                time=self._time,
                velocity=None if flown is None else np.array(flown),
            )
            variance = np.diag([std**2, std**2, 0.02**2])
            now = replace(now, covariance=np.tile(variance, (n, 1, 1)))
            airborne = np.ones(n, np.bool_)
            led, lands = self._agents.redirect(now, ~self._landing, self._landing, airborne, goals)
            self.events += [report.text for report in self._agents.reports]
            for row, reason in lands:
                self._landing[row] = True
                self.lands.append(f"cf{row + 1}: {reason}")
            sent = self._agents.stop(Setpoint(velocity, np.zeros(n), ~self._landing))
        self.goal = led.position
        return [bool(row.all()) for row in sent.velocity == velocity]


def test_an_agent_with_enough_room_flies_to_its_goal() -> None:
    flight = Flight()
    assert flight.at(NEAR, std=0.1, seconds=10.0) == [True]
    assert flight.goal.tolist() == [[*GOAL]]
    assert flight.events == flight.lands == []


def test_without_a_margin_nothing_happens_however_uncertain() -> None:
    flight = Flight(margin=0.0)
    assert flight.at(NEAR, std=5.0, seconds=10.0) == [True]
    assert flight.events == flight.lands == []


def test_an_agent_brakes_until_a_correction_arrives() -> None:
    flight = Flight()
    assert flight.at(NEAR, std=0.42) == [False]
    assert flight.events == [
        "cf1 is uncertain by 0.42 m and 0.30 m from obstacle 'box2': it brakes"
    ]
    assert flight.at(NEAR, std=0.03) == [True]
    assert flight.lands == []


def test_an_agent_that_brakes_at_a_wall_can_fly_away() -> None:
    flight = Flight()
    assert flight.at(NEAR, std=0.42) == [False]
    assert flight.at(NEAR, std=0.42, planned=(WEST,), seconds=2 * WAITING_TIME) == [True]
    assert flight.lands == []
    assert flight.at(NEAR, std=0.42, seconds=0.8 * WAITING_TIME) == [False]
    assert flight.lands == []
    flight.at(NEAR, std=0.42, seconds=WAITING_TIME)
    assert len(flight.lands) == 1


def test_an_agent_returns_to_where_it_was_corrected_last() -> None:
    flight = Flight()
    flight.at(FAR, std=0.3)
    flight.at(FAR, std=0.03)  # corrected
    flight.at(NEAR, std=0.42)
    assert flight.at(NEAR, std=0.42, seconds=WAITING_TIME + 0.1) == [True]  # the way back
    assert flight.goal.tolist() == [[*FAR[:2], NEAR[2]]]
    assert flight.events[-1].endswith("it returns to where it was located last")
    flight.at(FAR, std=0.1)
    assert flight.goal.tolist() == [[*GOAL]]
    assert flight.events[-1] == "cf1 is located again, to 0.10 m: it flies on"


def test_an_agent_that_was_never_corrected_lands() -> None:
    flight = Flight()
    flight.at(NEAR, std=0.41)
    flight.at(NEAR, std=0.42, seconds=WAITING_TIME + 0.1)
    assert flight.lands == ["cf1: uncertain by 0.42 m and 0.30 m from obstacle 'box2'"]


def test_an_agent_that_is_not_located_after_its_return_lands() -> None:
    flight = Flight()
    flight.at(FAR, std=0.3)
    flight.at(FAR, std=0.03)
    flight.at(NEAR, std=0.42, seconds=WAITING_TIME + 0.1)
    flight.at(FAR, std=0.5, seconds=20.0)
    assert flight.lands[0].endswith("and not located again")


def test_an_agent_lands_after_too_many_returns() -> None:
    flight = Flight()
    for _ in range(MAX_RETURNS + 1):
        assert flight.lands == []
        flight.at(FAR, std=0.3)
        flight.at(FAR, std=0.03)
        flight.at(NEAR, std=0.42, seconds=WAITING_TIME + 0.1)
    assert len(flight.lands) == 1


@pytest.mark.parametrize(("std", "brakes"), [(0.15, False), (0.5, True)])
def test_an_agent_brakes_at_the_fence_too(std: float, *, brakes: bool) -> None:
    flight = Flight()
    low = scene(1).world.fence.low
    assert flight.at((low[0] + 0.2, 0.0, 1.0), std=std, planned=(WEST,)) == [not brakes]
    assert [event.split(" m from ")[1] for event in flight.events] == (
        ["the fence: it brakes"] if brakes else []
    )
    assert flight.at((low[0] + 0.2, 0.0, 1.0), std=std, planned=(EAST,)) == [True]


MEETING = ((-4.0, 0.0, 1.0), (-3.2, 0.0, 1.0))  # 0.8 m apart: 1.5 * 0.32 * sqrt(2) + 0.12 m


def test_of_two_agents_without_room_the_later_one_lands() -> None:
    flight = Flight(2)
    assert flight.at(*MEETING, std=0.31, planned=(EAST, WEST)) == [True, True]
    assert flight.lands == []
    seconds = PARTING_TIME + 0.1
    assert flight.at(*MEETING, std=0.34, planned=(EAST, WEST), seconds=seconds)[0] is False
    assert flight.lands == ["cf2: uncertain by 0.34 m and 0.80 m from cf1"]
    assert flight.at(*MEETING, std=0.34, planned=(EAST, WEST), seconds=20.0)[0] is False
    above = (*MEETING[0][:2], 1.0), (*MEETING[1][:2], 0.6)
    assert flight.at(*above, std=0.34, planned=(EAST, WEST))[0] is True
    assert len(flight.lands) == 1


def test_agents_that_lack_room_for_a_moment_stop_but_do_not_land() -> None:
    flight = Flight(2)
    for _ in range(2):
        passing = flight.at(*MEETING, std=0.34, planned=(EAST, WEST), seconds=0.4 * PARTING_TIME)
        assert passing == [False, False]
        assert flight.at(*MEETING, std=0.31, planned=(EAST, WEST)) == [True, True]
    assert flight.events == flight.lands == []
    flight.at(*MEETING, std=0.34, planned=(EAST, WEST), seconds=0.4 * PARTING_TIME)
    assert len(flight.lands) == 1


def test_agents_that_close_in_land_before_they_cannot_brake() -> None:
    flight = Flight(2)
    closing = PARTING_TIME + 0.1
    flight.at(*MEETING, std=0.25, planned=(EAST, WEST), flown=(EAST, WEST), seconds=closing)
    assert len(flight.lands) == 1


def test_agents_that_fly_apart_do_not_land() -> None:
    flight = Flight(2)
    flight.at(*MEETING, std=0.5, planned=(WEST, EAST), flown=(WEST, EAST), seconds=10.0)
    assert flight.events == flight.lands == []


def test_an_agent_with_more_neighbors_lands_before_them() -> None:
    flight = Flight(3)
    row = (-4.0, 0.0, 1.0), (-3.2, 0.0, 1.0), (-2.4, 0.0, 1.0)
    flight.at(row[1], row[0], row[2], std=0.26, planned=(EAST,) * 3, seconds=1.0)
    assert [text.split(":")[0] for text in flight.lands] == ["cf1"]


def test_agents_that_are_corrected_wait_for_that_at_first() -> None:
    flight = Flight(2)
    flight.at(*MEETING, std=0.23, planned=(EAST, WEST))
    flight.at(*MEETING, std=0.1, planned=(EAST, WEST))
    assert flight.at(*MEETING, std=0.34, planned=(EAST, WEST)) == [False, False]
    assert flight.events == ["cf2 is uncertain by 0.34 m and 0.80 m from cf1: it brakes"]
    assert flight.at(*MEETING, std=0.1, planned=(EAST, WEST)) == [True, True]
    assert flight.lands == []
