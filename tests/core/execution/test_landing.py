"""Landings: from rest, and where nothing is below."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from star_core import AgentPhase, Command, Estimate, Goals, Limits, Obstacle, Supervisor
from star_core.commands.main import main
from star_core.execution.instructions import GoalDraft
from star_core.execution.landing import LandingManager
from star_core.messages.state import among
from star_core.testing import estimate, scene
from star_core.testing.inputs import flight_telemetry

HEAD = """
star: 1
name: down
world: room.yaml
rate: 10
limits: {speed: 0.5, height: [0.2, 2.2]}
transport: {use: sim, noise: false}
localizer: flow
planner: straight
avoider: %s
"""
ROOM = """
star: 1
name: room
fence: {low: [-4, -4, 0], high: [4, 4, 2.5]}
obstacles:
  table: {box: {centre: [2, 0], size: [0.8, 0.8]}, height: [0.6, 0.7]}
"""


def flown(
    folder: Path, mission: str, avoider: str = "orca", head: str = HEAD, room: str = ROOM
) -> dict[str, Any]:
    (folder / "room.yaml").write_text(room)
    (folder / "down.yaml").write_text(head % avoider + mission)
    out = folder / "out"
    main(["run", str(folder / "down.yaml"), "--json", "--out", str(out)])
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return summary


def landed(summary: dict[str, Any]) -> list[str]:
    return [event["text"] for event in summary["events"] if event["kind"] == "landing"]


@pytest.mark.parametrize("seconds", [1.6, 1.8, 2.2])
def test_agents_that_fly_at_each_other_brake_before_they_land(
    seconds: float, tmp_path: Path
) -> None:
    """An on-board landing keeps the speed a drone has: these two would meet on the way down."""
    mission = f"""
swarm: {{a: {{start: [-1, 0, 0]}}, b: {{start: [1, 0, 0]}}}}
mission:
  - takeoff: {{height: 1.0}}
  - parallel:
      - goto: {{agents: a, to: [1, 0, 1], until: {{elapsed: {seconds}}}}}
      - goto: {{agents: b, to: [-1, 0, 1], until: {{elapsed: {seconds}}}}}
  - land: {{}}
"""
    summary = flown(tmp_path, mission, "none")
    assert summary["outcome"] == "completed"
    assert summary["collisions"]["agent_agent"] == 0


def test_an_agent_comes_down_where_the_planner_leads_it(tmp_path: Path) -> None:
    """It starts too near to a pillar to land there, and the planner keeps clear by half a metre."""
    mission = """
swarm: {a: {start: [-1.42, 0, 0]}}
mission:
  - takeoff: {height: 1.0}
  - land: {}
"""
    pillar = "  pillar: {box: {centre: [-2, 0], size: [1, 1]}, height: [0, 2.5]}\n"
    planner = "planner: {use: visibility, clearance: 0.5}"
    head = HEAD.replace("planner: straight", planner)
    summary = flown(tmp_path, mission, "none", head, ROOM + pillar)
    assert summary["reason"] == ""
    assert landed(summary) == ["a lands 0.45 m aside: its position is not free"]


def test_landing_above_a_grounded_agent_is_moved_aside(tmp_path: Path) -> None:
    mission = """
swarm: {a: {start: [-1, 0, 0]}, b: {start: [0, 0, 0]}}
mission:
  - takeoff: {agents: a, height: 1.0}
  - goto: {agents: a, to: [0, 0, 1]}
  - land: {agents: a}
"""
    summary = flown(tmp_path, mission)
    assert summary["collisions"]["agent_agent"] == 0
    assert landed(summary) == ["a lands 0.35 m aside: its position is not free"]


def test_of_two_above_each_other_the_lower_lands_where_it_is(tmp_path: Path) -> None:
    mission = """
swarm: {a: {start: [-1, 0, 0]}, b: {start: [0, 0, 0]}}
mission:
  - takeoff: {agents: b, height: 0.6}
  - takeoff: {agents: a, height: 1.8}
  - goto: {agents: a, to: [0, 0, 1.8]}
  - land: {}
"""
    summary = flown(tmp_path, mission)
    assert summary["outcome"] == "completed"
    assert summary["collisions"]["agent_agent"] == 0
    assert [text[:8] for text in landed(summary)] == ["a lands "]


ABOVE_A_TABLE = """
swarm: {a: {start: [0, 0, 0]}}
mission:
  - takeoff: {height: 1.2}
  - goto: {to: [2, 0, 1.2]}
  - land: {}
"""
LANDED_AT_THE_END = """
swarm: {a: {start: [-1, 0, 0]}, b: {start: [0, 0, 0]}}
mission:
  - takeoff: {agents: a, height: 1.0}
  - goto: {agents: a, to: [0, 0, 1]}
"""


@pytest.mark.parametrize("mission", [ABOVE_A_TABLE, LANDED_AT_THE_END], ids=["table", "last"])
def test_no_agent_lands_on_a_table_or_on_another(mission: str, tmp_path: Path) -> None:
    summary = flown(tmp_path, mission)
    assert summary["outcome"] == "completed"
    assert summary["collisions"] == {"agent_agent": 0, "agent_obstacle": 0}
    assert len(landed(summary)) == 1


def test_agents_at_rest_with_none_below_land_where_they_are(tmp_path: Path) -> None:
    mission = """
swarm: {a: {start: [-1, 0, 0]}, b: {start: [0, 0, 0]}}
mission:
  - takeoff: {height: 1.0}
  - land: {}
"""
    assert landed(flown(tmp_path, mission)) == []


class Landings:
    """Landings of flying agents that are commanded, and their events.

    Args:
        phases: Of the agents.
        limits: Of the mission.
        obstacles: Of its world.
    """

    def __init__(
        self, phases: list[AgentPhase], limits: Limits | None = None, *obstacles: Obstacle
    ) -> None:
        self.landed: list[list[int]] = []
        self.commands: list[Command] = []
        self.reported: list[str] = []
        self.descending: list[list[int]] = []
        n = len(phases)
        self.drifts = np.zeros(n, bool)
        self.vehicles = SimpleNamespace(
            time=0.0,
            climb_top=np.ones(n),
            phases=SimpleNamespace(
                of_agents=lambda: np.array(phases, np.int64),
                among=lambda *some: among(np.array(phases, np.int64), *some),
            ),
            release=lambda _rows: None,
            drifts=lambda: self.drifts,
            descend=lambda rows: self.descending.append(list(rows)),
            send_command=lambda command, _estimate: self._sent(command),
        )
        observers: Any = SimpleNamespace(
            event=lambda _kind, text, _agent: self.reported.append(text)
        )
        vehicles: Any = self.vehicles
        room = scene(n, limits=limits)
        self.manager = LandingManager(
            replace(room, world=replace(room.world, obstacles=obstacles)),
            vehicles,
            observers,
            lambda places: np.zeros(len(places), bool),
        )

    def step(self, now: Estimate) -> None:
        self.manager.step(now, GoalDraft(Goals.none(len(now.valid))))

    def _sent(self, command: Command) -> None:
        self.commands.append(command)
        self.landed.append(command.agent.tolist())


@pytest.mark.parametrize(
    ("phase", "duration", "depth"),
    [(AgentPhase.FLYING, 3.4, 0.15), (AgentPhase.TAKING_OFF, 6.5, 0.25)],
)
def test_a_landing_takes_long_enough_to_touch_down_slowly(
    phase: AgentPhase, duration: float, depth: float
) -> None:
    """The plan of an agent that climbs may be at its top, 1 m here, and lead down from it."""
    landings = Landings([phase])
    landings.manager.land_now(np.array([0]), estimate(np.array([[0.0, 0.0, 0.2]])), np.array([0.5]))
    (command,) = landings.commands
    assert command.duration == pytest.approx([duration])
    assert command.position[0, 2] == pytest.approx(-depth)


def test_unlocated_landing_agents_keep_position_below_others() -> None:
    """The lower one is not located: it lands at once, where it is, and the other makes way."""
    landings = Landings([AgentPhase.FLYING] * 2)
    stacked = estimate(np.array([[0.0, 0.0, 1.5], [0.0, 0.0, 0.5]]))
    landings.manager.land([0, 1])
    landings.step(replace(stacked, valid=np.array([True, False])))
    assert landings.landed == [[1]]
    assert landings.reported == ["cf1 lands 0.60 m aside: its position is not free"]


@pytest.mark.parametrize("limit", [3.0, np.inf])
def test_drifting_agents_are_led_down_by_setpoints(limit: float) -> None:
    """Until it is on the floor, or as long as a descent from its height may take."""
    landings = Landings([AgentPhase.LOST])
    landings.drifts[0] = True
    lost = replace(estimate(np.array([[0.0, 0.0, 0.6]])), valid=np.zeros(1, bool))
    landings.manager.land([0])
    for k in range(120):
        landings.vehicles.time = time = 0.05 * k
        landings.drifts[0] = time < limit
        landings.step(lost)
        if landings.landed:
            break
    assert landings.landed == [[0]]
    assert time == pytest.approx(min(limit, 4.0), abs=0.06)
    assert landings.descending[:-1] == [[0]] * (len(landings.descending) - 1)
    assert landings.descending[-1] == []


@pytest.mark.parametrize("depth", [0.0, 1.0])
def test_no_agent_lands_below_one_that_may_descend(depth: float) -> None:
    landings = Landings([AgentPhase.FLYING, AgentPhase.LOST])
    level = estimate(np.array([[0.1, 0.0, 1.0], [0.0, 0.0, 1.0]]))
    travel = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -depth]])
    landings.manager.land([0])
    landings.step(replace(level, possible_travel=travel))
    assert bool(landings.reported) == (depth > 0)


@pytest.mark.parametrize(
    ("stds", "margin", "aside"),
    [
        ((0.01, 0.01), 2.0, []),
        ((0.01, 0.06), 2.0, ["cf1 lands 0.20 m aside: its position is not free"]),
        ((0.06, 0.01), 2.0, ["cf1 lands 0.20 m aside: its position is not free"]),
        ((5.0, 5.0), 2.0, ["cf1 lands 0.30 m aside: its position is not free"]),
        ((5.0, 5.0), 0.0, []),
    ],
)
def test_landing_clearance_grows_with_position_uncertainty(
    stds: tuple[float, float], margin: float, aside: list[str]
) -> None:
    landings = Landings([AgentPhase.FLYING, AgentPhase.LANDED], Limits(uncertainty_margin=margin))
    now = estimate(np.array([[0.0, 0.0, 1.0], [0.3, 0.0, 0.0]]))
    covariance = np.array([np.eye(3) * std**2 for std in stds])
    landings.manager.land([0])
    landings.step(replace(now, covariance=covariance))
    assert landings.reported == aside


HOVERS = Supervisor.FLYING | Supervisor.COMMANDER_FINISHED


class Reports:
    """An agent 1 m high that is commanded to land at 1 s, and what its reports cause."""

    def __init__(self) -> None:
        self._phases = [AgentPhase.FLYING]
        self._landings = Landings(self._phases)
        self.at(1.0, HOVERS)
        self._landings.manager.land_now(np.array([0]), self._estimate)
        self._phases[0] = AgentPhase.LANDING

    def at(self, time: float, state: Supervisor, age: float = 0.0, height: float = 1.0) -> int:
        """Receive a report of some age, s, at a time, s; return how many landings it causes."""
        self._landings.vehicles.time = time
        self._estimate = estimate(np.array([[0.0, 0.0, height]]), time=time)
        room, none = scene(1), np.zeros(1, np.bool_)
        report = replace(
            flight_telemetry(room, time, none, none),
            state=np.array([int(state)]),
            age=np.array([age]),
        )
        before = len(self._landings.landed)
        self._landings.manager.repeat_missed(report, self._estimate)
        return len(self._landings.landed) - before


def test_hovering_after_a_land_command_repeats_the_command() -> None:
    reports = Reports()
    assert [reports.at(t, HOVERS) for t in (1.05, 1.5, 1.8)] == [0, 0, 1]
    assert [reports.at(t, HOVERS) for t in (1.85, 2.4, 2.6)] == [0, 0, 1]


def test_stale_or_missing_reports_do_not_repeat_a_land_command() -> None:
    reports = Reports()
    assert [reports.at(t, HOVERS, age=t - 0.9) for t in (1.2, 2.0, 4.0)] == [0, 0, 0]
    assert reports.at(2.0, HOVERS, age=0.45) == 0
    assert reports.at(2.2, HOVERS, age=0.45) == 1


def test_an_agent_that_lands_is_not_commanded_again() -> None:
    """It reports to fly for 2 s after its motors stopped; the motors must not start again."""
    reports = Reports()
    down = 1.0 + 5.0  # s, the end of its landing
    descent = [reports.at(t, Supervisor.FLYING) for t in np.arange(1.05, down, 0.05)]
    after = [reports.at(t, HOVERS) for t in np.arange(down, down + 2.2, 0.05)]
    over = [reports.at(t, Supervisor.COMMANDER_FINISHED) for t in np.arange(down + 2.2, 20, 0.05)]
    assert not any(descent + after + over)


def test_agents_heard_after_their_landing_time_land_again() -> None:
    reports = Reports()
    lands = [t for t in np.arange(9.0, 16.0, 0.05) if reports.at(t, HOVERS)]
    assert lands[0] == pytest.approx(12.0, abs=0.06)
    assert lands[1] == pytest.approx(lands[0] + 0.7, abs=0.06)


@pytest.mark.parametrize(
    ("bit", "landings"), [(Supervisor.COMMANDER_ACTIVE, 1), (Supervisor.CAN_FLY, 0)]
)
def test_an_agent_on_the_ground_with_its_motors_on_is_landed(
    bit: Supervisor, landings: int
) -> None:
    """It came down by itself before its link returned, and would not stop its motors."""
    reports = Reports()
    times = np.arange(9.0, 12.5, 0.05)
    assert sum(reports.at(t, HOVERS | bit, height=0.02) for t in times) == landings


def test_stuck_hover_reports_repeat_landing_three_times() -> None:
    """Reports may be stuck; a flight must end."""
    reports = Reports()
    assert sum(reports.at(t, HOVERS) for t in np.arange(1.05, 60.0, 0.05)) == 3


@pytest.mark.parametrize(
    ("std", "margin", "aside"),
    [
        (0.0, 2.0, []),
        (0.1, 2.0, ["cf1 lands 0.35 m aside: its position is not free"]),
        (0.1, 0.0, []),
    ],
)
def test_an_uncertain_agent_lands_farther_from_obstacles(
    std: float, margin: float, aside: list[str]
) -> None:
    pillar = Obstacle("pillar", (((-1.3, -1), (-0.3, -1), (-0.3, 1), (-1.3, 1)),), (0.0, 3.0))
    landings = Landings([AgentPhase.FLYING], Limits(uncertainty_margin=margin), pillar)
    now = estimate(np.array([[0.0, 0.0, 1.0]]))
    landings.manager.land([0])
    landings.step(replace(now, covariance=std**2 * np.eye(3)[None]))
    assert landings.reported == aside


def test_an_uncertain_agent_lands_inside_the_fence() -> None:
    landings = Landings([AgentPhase.FLYING])
    low, high = scene(1).world.fence.low, scene(1).world.fence.high
    now = estimate(np.array([[high[0] - 0.1, (low[1] + high[1]) / 2, 1.0]]))
    landings.manager.land([0])
    landings.step(replace(now, covariance=0.1**2 * np.eye(3)[None]))
    assert landings.reported == ["cf1 lands 0.25 m aside: its position is not free"]
