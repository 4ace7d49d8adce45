"""Agents whose uncertainty leaves no room brake, return to where they were located, or land."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from star_core import Goals, Limits, Obstacle
from star_core.safety.uncertain_agents import BRAKE_TIME, MAX_RETURNS, UncertainAgents
from star_core.testing import estimate, scene

BOX = Obstacle("box2", (((1.0, -1.0), (2.0, -1.0), (2.0, 1.0), (1.0, 1.0)),), (0.0, 2.0))
GOAL = (0.8, 0.5, 1.0)
FAR, NEAR = (-0.5, 0.0, 1.0), (0.7, 0.0, 1.0)  # from the box


class Flight:
    """One agent near a box, with the events about it and where it is led."""

    def __init__(self, margin: float = 2.0) -> None:
        room = scene(1, limits=Limits(uncertainty_margin=margin))
        self.events: list[str] = []
        self.lands: list[str] = []
        self._agents = UncertainAgents(
            replace(room, world=replace(room.world, obstacles=(BOX,))),
            lambda text, _agent: self.events.append(text),
        )
        self._time = 0.0

    def at(self, position: tuple[float, ...], std: float, seconds: float = 0.05) -> list[float]:
        """Be at a position for a while, m, with a standard deviation, m; return the last goal."""
        wanted = Goals(
            *(np.array([GOAL]), np.full((1, 3), 0.1), np.zeros(1), np.full(1, 0.5)),
            np.ones(1, np.bool_),
        )
        for _ in range(round(seconds / 0.05)):
            self._time += 0.05
            now = estimate(np.array([position]), time=self._time)
            now = replace(now, covariance=std**2 * np.eye(3)[None])
            led, lands = self._agents.redirect(now, np.ones(1, np.bool_), wanted)
            self.lands += [reason for _, reason in lands]
            assert lands or led.velocity.any() == (led.position[0].tolist() == [*GOAL])
        goal: list[float] = led.position[0].tolist()
        return goal


def test_an_agent_with_enough_room_flies_to_its_goal() -> None:
    flight = Flight()
    assert flight.at(NEAR, 0.1, 10.0) == [*GOAL]
    assert flight.events == flight.lands == []


def test_without_a_margin_nothing_happens_however_uncertain() -> None:
    flight = Flight(margin=0.0)
    assert flight.at(NEAR, 5.0, 10.0) == [*GOAL]
    assert flight.events == flight.lands == []


def test_an_agent_brakes_until_a_correction_arrives() -> None:
    flight = Flight()
    assert flight.at(NEAR, 0.42) == [*NEAR]
    assert flight.events == [
        "cf1 is uncertain by 0.42 m and 0.30 m from obstacle 'box2': it brakes"
    ]
    assert flight.at(NEAR, 0.03) == [*GOAL]
    assert flight.lands == []


def test_an_agent_returns_to_where_it_was_corrected_last() -> None:
    flight = Flight()
    flight.at(FAR, 0.3)
    flight.at(FAR, 0.03)  # corrected
    flight.at(NEAR, 0.42)
    assert flight.at(NEAR, 0.42, BRAKE_TIME + 0.1) == [*FAR[:2], NEAR[2]]
    assert flight.events[-1].endswith("it returns to where it was located last")
    assert flight.at(FAR, 0.1) == [*GOAL]
    assert flight.events[-1] == "cf1 is located again, to 0.10 m: it flies on"


def test_an_agent_that_was_never_corrected_lands() -> None:
    flight = Flight()
    flight.at(NEAR, 0.41)
    flight.at(NEAR, 0.42, BRAKE_TIME + 0.1)
    assert flight.lands == ["uncertain by 0.42 m and 0.30 m from obstacle 'box2'"]


def test_an_agent_that_is_not_located_after_its_return_lands() -> None:
    flight = Flight()
    flight.at(FAR, 0.3)
    flight.at(FAR, 0.03)
    flight.at(NEAR, 0.42, BRAKE_TIME + 0.1)
    flight.at(FAR, 0.5, 20.0)
    assert flight.lands[0].endswith("and not located again")


def test_an_agent_lands_after_too_many_returns() -> None:
    flight = Flight()
    for _ in range(MAX_RETURNS + 1):
        assert flight.lands == []
        flight.at(FAR, 0.3)
        flight.at(FAR, 0.03)
        flight.at(NEAR, 0.42, BRAKE_TIME + 0.1)
    assert len(flight.lands) == 1


@pytest.mark.parametrize(("std", "brakes"), [(0.15, False), (0.5, True)])
def test_an_agent_brakes_at_the_fence_too(std: float, *, brakes: bool) -> None:
    flight = Flight()
    low = scene(1).world.fence.low
    flight.at((low[0] + 0.2, 0.0, 1.0), std)
    assert [event.split(" m from ")[1] for event in flight.events] == (
        ["the fence: it brakes"] if brakes else []
    )
