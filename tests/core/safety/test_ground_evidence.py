"""What shows that an agent is on the ground, and what does not."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Order, Supervisor, Telemetry
from star_core.toolkit import GroundEvidence

FLYING, FINISHED = Supervisor.FLYING, Supervisor.COMMANDER_FINISHED
BY_COMMANDER = FLYING | Supervisor.COMMANDER_ACTIVE
HOVERS = BY_COMMANDER | FINISHED
LANDING = 3.0  # s


class Agent:
    """One agent, its reports and its commands."""

    def __init__(self) -> None:
        self.evidence = GroundEvidence(1)
        self.time = 0.0  # s
        self._reported = 0.0
        self.report(0, 0.0)

    def report(self, state: int, height: float, seconds: float = 0.1) -> None:
        """Let some time pass, and report at its end."""
        self.time += seconds
        self._reported = self.time
        self._observe(state, height)

    def silence(self, seconds: float) -> None:
        """Let some time pass without a report."""
        self.time += seconds
        self._observe(0, 0.0)

    def _observe(self, state: int, height: float) -> None:
        position, still = np.array([[0.0, 0.0, height]]), np.zeros((1, 3))
        attitude, battery = np.array([[0.0, 0.0, 0.0, 1.0]]), np.array([4.0])
        age, bits = np.array([self.time - self._reported]), np.array([int(state)])
        table = Telemetry(self.time, position, still, attitude, battery, bits, age)
        self.evidence.observe(self.time, table)

    def order(self, order: Order) -> None:
        until = np.array([self.time + LANDING])
        self.evidence.commanded(self.time, order, np.array([0]), until)

    def steer(self) -> None:
        self.evidence.steered(self.time, np.array([True]))

    @property
    def down(self) -> bool:
        return bool(self.evidence.down(self.time)[0])


@pytest.fixture
def hovering() -> Agent:
    """An agent that hovers after its take-off."""
    agent = Agent()
    assert agent.down
    agent.order(Order.TAKEOFF)
    assert not agent.down
    agent.report(BY_COMMANDER, 0.3)
    agent.report(HOVERS, 0.7, 2.0)
    return agent


@pytest.fixture
def steered(hovering: Agent) -> Agent:
    """An agent that reports to be flown by setpoints."""
    hovering.steer()
    hovering.report(FLYING | FINISHED, 0.7)
    hovering.steer()
    return hovering


def test_agents_silent_since_their_takeoff_are_never_down() -> None:
    agent = Agent()
    agent.order(Order.TAKEOFF)
    agent.silence(1.0)
    agent.order(Order.LAND)
    agent.silence(1000.0)
    assert not agent.down
    assert agent.evidence.describe(0, agent.time) == "not heard for 1001.0 s, last at 0.00 m"


def test_refused_takeoffs_are_recognized_after_a_while() -> None:
    agent = Agent()
    agent.order(Order.TAKEOFF)
    agent.report(0, 0.0, 1.0)
    assert not agent.down
    agent.report(0, 0.0, 1.0)
    assert agent.down


def test_an_unheard_agent_that_hovers_is_never_down(hovering: Agent) -> None:
    hovering.order(Order.LAND)
    hovering.silence(1000.0)
    assert not hovering.down


def test_setpoints_that_no_report_has_confirmed_prove_nothing(hovering: Agent) -> None:
    hovering.steer()
    hovering.silence(1000.0)
    assert not hovering.down


def test_the_watchdog_ends_the_flight_of_an_unheard_agent(steered: Agent) -> None:
    steered.silence(2.9)
    assert not steered.down
    steered.silence(0.2)
    assert steered.down
    assert steered.evidence.describe(0, steered.time).endswith(" by its own watchdog")
    steered.report(HOVERS, 0.7)
    assert not steered.down


@pytest.mark.parametrize("order", [Order.GOTO, Order.TAKEOFF])
def test_no_watchdog_ends_what_is_flown_on_board(steered: Agent, order: Order) -> None:
    steered.order(order)
    steered.silence(1000.0)
    assert not steered.down


def test_a_landing_that_had_begun_ends_without_a_link(hovering: Agent) -> None:
    hovering.order(Order.LAND)
    hovering.report(BY_COMMANDER, 0.72)
    hovering.report(BY_COMMANDER, 0.6)
    hovering.silence(LANDING)
    assert not hovering.down
    hovering.silence(2.0)
    assert hovering.down
    assert hovering.evidence.describe(0, hovering.time).endswith("had begun, and is over")


def test_a_drop_before_the_landing_does_not_show_that_it_began(hovering: Agent) -> None:
    hovering.report(HOVERS, 0.5)
    hovering.order(Order.LAND)
    hovering.report(HOVERS, 0.48)
    hovering.silence(1000.0)
    assert not hovering.down


def test_reports_show_that_an_agent_has_landed(hovering: Agent) -> None:
    hovering.order(Order.LAND)
    hovering.report(BY_COMMANDER, 0.05)
    assert not hovering.down
    hovering.report(FLYING | FINISHED, 0.05)  # its motors have just stopped
    assert hovering.down
    hovering.silence(1000.0)
    assert hovering.down


def test_an_agent_on_the_floor_with_its_motors_on_is_not_down(hovering: Agent) -> None:
    hovering.order(Order.LAND)
    hovering.report(HOVERS, 0.01)  # its commander brought it down by itself
    assert not hovering.down


def test_an_order_to_stop_is_no_evidence_that_the_motors_stopped(hovering: Agent) -> None:
    hovering.order(Order.STOP)
    assert hovering.evidence.stop_unconfirmed(hovering.time).all()
    hovering.silence(1000.0)
    assert hovering.evidence.stop_unconfirmed(hovering.time).all()
    hovering.report(0, 0.0)
    assert not hovering.evidence.stop_unconfirmed(hovering.time).any()
