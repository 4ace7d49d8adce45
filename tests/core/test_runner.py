"""Flights: what is sent to which agent, and all agents down at the end."""

from __future__ import annotations

import gc
import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import star_yaml
from star_core import (
    AgentPhase,
    Estimate,
    Order,
    Plan,
    Setpoint,
    Supervisor,
    Telemetry,
    fly,
    hookimpl,
)
from star_core.discovery import Source
from star_core.execution.land_all import MAX_LANDING_DELAY, MAX_SILENCE
from star_core.execution.landing import CONTROLLER_LAG, LAND_DEPTH, LAND_SPEED
from star_core.plugin_support.registry import Registry
from star_core.tick import MAX_LOST_TIME
from star_core.toolkit.landing_time import MIN_LAND_TIME, MIN_LAND_TIME_PER_HEIGHT
from tests.core.conftest import TOUR, Lab, heard

FLYING = range(20, 10**6)  # calls: the agents fly from the 11th tick to the 31st
BOOM = RuntimeError("boom")
ALL = np.array([True, True])
FIRST = np.array([True, False])
IN_THE_AIR = """
  - climb: {}
  - wait: {seconds: 2}
"""
PLACES = """
  - climb: {}
  - visit: {agents: cf1, to: [1, 0, 1]}
  - visit: {agents: cf2, to: [0, 1, 1.5]}
  - descend: {}
"""


def bits(row: int, state: Supervisor, since: float = 2.0) -> Callable[..., Telemetry]:
    """Report bits of an agent's supervisor beside its own from a mission time on, s."""
    return heard(
        lambda now: {
            "state": now.state
            | (int(state) * (np.arange(len(now.state)) == row) * (now.time > since))
        }
    )


def active(right: Callable[..., Any], *args: Any) -> Any:
    """Answer with every row of the setpoint active."""
    answer = right(*args)
    if isinstance(answer, Plan):
        return replace(answer, setpoint=replace(answer.setpoint, active=ALL))
    return replace(answer, active=ALL)


def sent_outside(lab: Lab, *phases: AgentPhase) -> list[tuple[float, int]]:
    """Times and rows at which something was sent to an agent that was in none of the phases."""
    sent = dict(lab.robots.sent)
    return [
        (tick.time, row)
        for tick in lab.ticks
        if tick.time in sent
        for row in np.flatnonzero(sent[tick.time].active).tolist()
        if tick.health.phase[row] not in phases
    ]


def test_a_mission_that_goes_well_is_completed(lab: Lab) -> None:
    summary = lab.fly(PLACES)
    assert (summary["outcome"], summary["reason"]) == ("completed", "")
    assert lab.went(None) == ["flying", "landing", "completed"]
    assert lab.said("failure") == []


@pytest.mark.parametrize("realtime", [False, True])
def test_every_part_receives_whether_time_goes_on_by_itself(lab: Lab, *, realtime: bool) -> None:
    lab.realtime = realtime
    lab.registry = Registry(star_yaml, installed=False)
    lab.registry.add(lab, Source("their-dist:lab"))
    assert lab.load().scene.realtime is realtime


class Frozen:
    """Notes how many objects are excluded from garbage collection in every 25th tick.

    They are counted one by one, which takes a while.
    """

    def __init__(self) -> None:
        self.counts: list[int] = []
        self._ticks = itertools.count()

    @hookimpl
    def star_ticked(self) -> None:
        if next(self._ticks) % 25 == 0:
            self.counts.append(gc.get_freeze_count())


@pytest.fixture
def unfrozen() -> Iterator[None]:
    """Nothing is frozen: objects of collected tests are, otherwise."""
    gc.unfreeze()
    yield
    gc.freeze()


@pytest.mark.usefixtures("unfrozen")
@pytest.mark.parametrize("realtime", [False, True])
def test_real_time_flights_freeze_earlier_objects_from_gc(lab: Lab, *, realtime: bool) -> None:
    frozen = Frozen()
    lab.realtime = realtime
    lab.registry = Registry(star_yaml, installed=False)
    lab.registry.add(lab, Source("their-dist:lab"))
    lab.registry.add(frozen, Source("their-dist:frozen"))
    fly(lab.load(PLACES), lab.registry)
    assert len(frozen.counts) > 1
    assert all((count > 0) is realtime for count in frozen.counts)
    assert gc.get_freeze_count() == 0


def test_agents_that_a_mission_leaves_in_the_air_are_landed(lab: Lab) -> None:
    summary = lab.fly(IN_THE_AIR)
    assert summary["outcome"] == "completed"
    assert sorted(lab.ordered(Order.LAND)) == [0, 1]
    assert [lab.went(name)[-1] for name in lab.swarm] == ["landed", "landed"]
    _, landing = lab.robots.commands[-1]
    assert landing.duration == pytest.approx([LANDING] * 2)
    assert landing.position[:, 2] == pytest.approx([-LAND_DEPTH] * 2)


LANDING = MIN_LAND_TIME + MIN_LAND_TIME_PER_HEIGHT  # s, from 1 m


def second_agent_at(height: float, climb: float) -> Callable[..., Estimate]:
    """Put the second agent at a height, m, and let it climb, m/s, once it has taken off."""

    def wrong(right: Callable[..., Estimate], telemetry: Telemetry) -> Estimate:
        estimate = right(telemetry)
        position, velocity = estimate.position.copy(), estimate.velocity.copy()
        position[1, 2], velocity[1, 2] = height, climb
        return replace(estimate, position=position, velocity=velocity)

    return wrong


@pytest.mark.parametrize("height", [0.25, 0.4])
def test_a_landing_from_low_down_is_given_time(lab: Lab, height: float) -> None:
    low = heard(lambda now: {"position": [now.position[0], [*now.position[1, :2], height]]})
    lab.spoil("transport", "receive", low, FLYING)
    lab.spoil("localizer", "locate", second_agent_at(height, 0.0), FLYING)
    lab.fly(IN_THE_AIR)
    landings = [c for _, c in lab.robots.commands if c.order is Order.LAND and 1 in c.agent]
    slow = MIN_LAND_TIME + MIN_LAND_TIME_PER_HEIGHT * height
    assert [c.duration[c.agent == 1].tolist() for c in landings] == [[slow]]


def test_landings_during_a_climb_are_timed_from_planned_height(lab: Lab) -> None:
    lab.spoil("planner", "plan", BOOM, FLYING)  # the landing does not wait for it to be at rest
    lab.spoil("localizer", "locate", second_agent_at(1.0, 0.6), FLYING)
    lab.fly(IN_THE_AIR)
    (landing,) = (c for _, c in lab.robots.commands if c.order is Order.LAND)
    assert landing.duration[1] == pytest.approx(
        LANDING + 0.6 * CONTROLLER_LAG * MIN_LAND_TIME_PER_HEIGHT
    )


def test_agents_that_never_took_off_are_not_landed(lab: Lab) -> None:
    lab.fly("\n  - climb: {agents: cf1}\n  - wait: {seconds: 1}")
    assert lab.ordered(Order.LAND) == [0]
    assert lab.went("cf2") == []


def test_dead_transports_are_closed_although_no_agent_landed(lab: Lab) -> None:
    for method, calls in (("wait", FLYING), ("send", FLYING), ("command", range(1, 10**6))):
        lab.spoil("transport", method, BOOM, calls)
    summary = lab.fly()
    assert summary["outcome"] == "failed"
    assert "; no agent could be landed: transport 'robots'" in summary["reason"]
    assert lab.said("failure")[-1].startswith("no agent could be landed: transport 'robots'")
    left = {event.agent: event.text for event in lab.events if event.agent}
    assert left == {
        name: f"{name} is left to the transport's close, and its own timeouts"
        for name in ("cf1", "cf2")
    }
    assert lab.closed["transport"] == 1


def test_transports_that_only_fail_to_send_still_land_agents(lab: Lab) -> None:
    lab.spoil("transport", "send", BOOM, FLYING)
    lab.fly()
    assert [lab.went(name)[-1] for name in lab.swarm] == ["landed", "landed"]


def test_all_agents_land_without_a_localizer_that_is_broken(lab: Lab) -> None:
    lab.spoil("localizer", "locate", BOOM, FLYING)
    lab.fly()
    blind = [tick for tick in lab.ticks if tick.time > 2.2]
    assert blind
    assert not any(tick.estimate.valid.any() for tick in blind)
    assert [lab.went(name)[-1] for name in lab.swarm] == ["landed", "landed"]


def test_nothing_is_sent_once_a_planner_is_broken(lab: Lab) -> None:
    lab.spoil("planner", "plan", BOOM, FLYING)
    lab.fly()
    assert max(time for time, _ in lab.robots.sent) == pytest.approx(2.1)  # two were tolerated


def test_agents_that_report_no_landing_are_named_after_a_timeout(lab: Lab) -> None:
    lab.spoil("transport", "receive", bits(1, Supervisor.FLYING))
    summary = lab.fly(IN_THE_AIR)
    assert summary["outcome"] == "failed"
    assert summary["reason"] == "cf2 did not report to be on the ground"
    assert lab.said("landing") == ["waiting for cf2 to report a landing"]
    assert summary["reason"] in lab.said("failure")
    assert lab.ticks[-1].time == pytest.approx(3.0 + LANDING + MAX_LANDING_DELAY, abs=0.3)
    assert lab.closed["transport"] == 1


def silent(since: float) -> Callable[..., Telemetry]:
    """Do not hear the second agent from a mission time on, s."""
    return heard(
        lambda now: {
            "age": [0.0, max(0.0, now.time - since)],
            "state": now.state | [0, int(Supervisor.FLYING)],
        }
    )


@pytest.mark.parametrize(
    ("steps", "since", "ends"),
    [
        (IN_THE_AIR, 2.5, 3.0 + LANDING),
        (IN_THE_AIR, 5.0, 3.0 + LANDING),  # setpoints flew it: its watchdog has stopped its motors
        ("\n  - climb: {}", 3.0, 3.0 + MAX_SILENCE),
    ],
)
def test_agents_never_heard_again_are_awaited_until_landing_time(
    lab: Lab, steps: str, since: float, ends: float
) -> None:
    lab.spoil("transport", "receive", silent(since))
    summary = lab.fly(steps)
    assert "cf2 did not report to be on the ground" in summary["reason"]
    assert lab.ticks[-1].time == pytest.approx(ends, abs=0.3)


def test_unheard_ends_of_landings_soon_fail_the_mission(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(3.5))
    summary = lab.fly()
    assert summary["reason"].startswith("cf2 is lost")
    (begun,) = {time for time, command in lab.robots.commands if command.order is Order.LAND}
    assert lab.ticks[-1].time < begun + LANDING + MAX_LOST_TIME + 1.0


LEAVES = "safety: {{link_lost: {{after: 0.6, then: {}}}}}"


def test_an_agent_that_is_lost_in_its_take_off_fails_the_mission(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(0.3))
    summary = lab.fly(f"{TOUR}{LEAVES.format('land')}")
    assert [step["outcome"] for step in summary["steps"]] == ["success"] * 3
    assert summary["reason"] == "cf2 did not report to be on the ground"
    assert summary["outcome"] == "failed"
    (airborne,) = (event for event in lab.events if event.kind == "airborne")
    assert airborne.agent == "cf2"
    assert airborne.text.startswith("cf2 may be in the air: not heard for ")


def test_agents_under_setpoints_are_landed_by_their_watchdog(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(2.0))
    summary = lab.fly(f"{TOUR}{LEAVES.format('land')}")
    assert summary["outcome"] == "completed"
    (text,) = (event.text for event in lab.events if event.kind == "landing")
    assert text.startswith("cf2 counts as landed: not heard for ")
    assert text.endswith(" s: down, at the latest by its own watchdog")


def test_lost_agents_are_not_assumed_to_have_stopped_motors(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(0.3))
    summary = lab.fly(f"{TOUR}{LEAVES.format('stop')}")
    assert lab.went("cf2")[-1] == "emergency"
    assert summary["reason"] == "cf2 did not report to be on the ground"
    assert summary["outcome"] == "failed"


def voltage(row: int, volts: float) -> Callable[..., Telemetry]:
    """Report another voltage of one agent's battery."""
    return heard(
        lambda now: {"battery": np.where(np.arange(len(now.age)) == row, volts, now.battery)}
    )


def test_a_battery_below_its_rule_is_refused_before_the_start(lab: Lab) -> None:
    lab.spoil("transport", "receive", voltage(1, 3.1))
    summary = lab.fly(f"{TOUR}safety: {{battery_low: {{below: 3.2}}}}")
    assert summary["reason"] == "not started: battery_low: cf2 at 3.10 V, below 3.2 V"
    assert summary["outcome"] == "failed"
    assert lab.robots.commands == []


def test_a_reserve_with_a_low_battery_does_not_prevent_the_start(lab: Lab) -> None:
    lab.spoil("transport", "receive", voltage(1, 3.1))
    more = "reserve: {agents: [cf2]}\n"
    steps = TOUR.replace("{}", "{agents: cf1}")
    summary = lab.fly(f"{steps}safety: {{battery_low: {{below: 3.2}}}}", more=more)
    assert summary["outcome"] == "completed"


def test_interrupts_while_closing_plugins_complete_the_record(lab: Lab) -> None:
    lab.spoil("transport", "close", KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        lab.fly()
    (summary,) = lab.summaries
    assert summary["outcome"] == "completed"
    assert lab.closed["localizer"] == 1


def rebooted(since: float) -> Callable[..., Telemetry]:
    """Report that the second agent rebooted, from a mission time on, s, and nothing else of it."""
    return heard(
        lambda now: {
            "age": [0.0, max(0.0, now.time - since)],
            "rebooted": [False, now.time >= since],
        }
    )


@pytest.mark.parametrize(
    ("since", "words"),
    [
        (2.0, "cf2 rebooted in flight: its motors stopped; it is not flown any more"),
        (0.0, "cf2 rebooted before its take-off; it is not flown any more"),
    ],
)
def test_an_agent_that_rebooted_is_reported_once_and_not_landed(
    lab: Lab, since: float, words: str
) -> None:
    lab.spoil("transport", "receive", rebooted(since))
    summary = lab.fly(IN_THE_AIR)
    assert lab.said("failure").count(words) == 1
    assert summary["outcome"] == "failed"
    assert lab.went("cf2")[-1] == "emergency"
    assert 1 not in lab.ordered(Order.LAND)


def test_reboots_after_landing_do_not_fail_the_mission(lab: Lab) -> None:
    lab.spoil("transport", "receive", rebooted(6.0))
    steps = "\n  - climb: {}\n  - descend: {agents: cf2}\n  - wait: {seconds: 5}"
    assert lab.fly(steps)["outcome"] == "completed"


def test_failure_reason_precedes_problems_while_landing(lab: Lab) -> None:
    lab.spoil("transport", "receive", bits(1, Supervisor.FLYING))
    summary = lab.fly(f"{IN_THE_AIR}\n  - wait: {{seconds: 9, limit: 1}}")
    why, _, then = summary["reason"].partition("; ")
    assert why.endswith(" wait cf1, cf2 failed: timed out after 1 s")
    assert then == "cf2 did not report to be on the ground"


@pytest.mark.parametrize(
    ("bit", "cause"),
    [
        (Supervisor.TUMBLED, "tumbled"),
        (Supervisor.LOCKED, "locked until a reboot"),
        (Supervisor.CRASHED, "crashed, needs crash recovery"),
        (Supervisor.DECK_FAULT, "deck fault"),
    ],
)
def test_emergencies_fail_the_step_and_land_the_others(
    lab: Lab, bit: Supervisor, cause: str
) -> None:
    lab.spoil("transport", "receive", bits(1, bit))
    summary = lab.fly()
    assert summary["outcome"] == "failed"
    assert summary["reason"].endswith(f" wait cf1, cf2 failed: cf2 is emergency: {cause}")
    assert f"cf2 is emergency: {cause}" in lab.said("failure")
    assert lab.went("cf1")[-1] == "landed"
    assert lab.went("cf2")[-1] == "emergency"
    assert lab.ordered(Order.LAND) == [0]


def test_emergencies_at_the_end_fail_the_mission(lab: Lab) -> None:
    lab.spoil("transport", "receive", bits(1, Supervisor.CRASHED, since=3.5))
    summary = lab.fly(IN_THE_AIR)
    assert (summary["outcome"], summary["reason"]) == ("failed", "cf2 ended in emergency")
    assert lab.went(None)[-1] == "failed"


@pytest.mark.parametrize(("role", "method"), [("planner", "plan"), ("avoider", "avoid")])
def test_only_flying_agents_are_sent_anything(lab: Lab, role: str, method: str) -> None:
    lab.spoil(role, method, active)
    lab.spoil("transport", "receive", bits(1, Supervisor.TUMBLED))
    lab.fly(TAKE_TURNS)
    assert {row for _, sent in lab.robots.sent for row in np.flatnonzero(sent.active)} == {0, 1}
    assert sent_outside(lab, AgentPhase.FLYING) == []


TAKE_TURNS = """
  - climb: {agents: cf1}
  - climb: {agents: cf2}
  - wait: {seconds: 2, agents: cf1}
  - descend: {agents: cf1}
  - descend: {agents: cf2, on_failure: continue}
"""


def test_agents_that_are_not_heard_are_not_sent_anything(lab: Lab) -> None:
    deaf = heard(lambda now: {"age": [0.0, 0.6 * (2.0 < now.time < 2.6)]})
    lab.spoil("planner", "plan", active)
    lab.spoil("avoider", "avoid", active)
    lab.spoil("transport", "receive", deaf)
    lab.fly("\n  - climb: {}\n  - wait: {seconds: 3, agents: cf1}\n  - descend: {}")
    assert "lost" in lab.went("cf2")
    assert sent_outside(lab, AgentPhase.FLYING) == []


def test_agents_that_are_heard_but_not_located_brake(lab: Lab) -> None:
    def blind(right: Callable[..., Estimate], telemetry: Telemetry) -> Estimate:
        return replace(right(telemetry), valid=np.array([True, not 2.0 < telemetry.time < 2.6]))

    lab.spoil("planner", "plan", active)
    lab.spoil("avoider", "avoid", active)
    lab.spoil("localizer", "locate", blind)
    lab.fly("\n  - climb: {}\n  - wait: {seconds: 3, agents: cf1}\n  - descend: {}")
    meanwhile = [sent for time, sent in lab.robots.sent if 2.05 < time < 2.55]
    assert [sent.active.tolist() for sent in meanwhile] == [[True, True]] * 5
    assert all((sent.velocity[1] == 0).all() for sent in meanwhile)


def test_agents_on_an_on_board_goto_are_sent_no_setpoints(lab: Lab) -> None:
    lab.spoil("planner", "plan", active)
    lab.spoil("avoider", "avoid", active)
    lab.fly("\n  - climb: {}\n  - ride: {agents: cf2, to: [0, 2, 1], seconds: 2}\n  - descend: {}")
    ((ordered, _),) = (item for item in lab.robots.commands if item[1].order is Order.GOTO)
    riding = [
        sent.active.tolist()
        for time, sent in lab.robots.sent
        if ordered - 0.01 < time < ordered + 1.95
    ]
    assert riding == [[True, False]] * 20


def test_stale_commander_reports_do_not_end_a_goto(lab: Lab) -> None:
    over = int(Supervisor.COMMANDER_FINISHED)  # of the climb, as a slow link still tells it
    late = heard(lambda now: {"state": now.state | over})
    lab.spoil("transport", "receive", late, range(12, 25))
    lab.fly("\n  - climb: {}\n  - ride: {agents: cf2, to: [0, 2, 1], seconds: 2}\n  - descend: {}")
    ((ordered, _),) = (item for item in lab.robots.commands if item[1].order is Order.GOTO)
    riding = [sent for time, sent in lab.robots.sent if ordered - 0.01 < time < ordered + 1.95]
    assert not any(sent.active[1] for sent in riding)


def test_agents_get_setpoints_again_after_an_on_board_goto(lab: Lab) -> None:
    lab.fly(
        "\n  - climb: {}\n  - ride: {agents: cf2, to: [0, 2, 1]}"
        "\n  - visit: {agents: cf2, to: [0, 3, 1]}"
    )
    assert lab.ticks[-1].estimate.position[1] == pytest.approx([0.0, 3.0, 0.0])


def test_rows_that_the_avoider_adds_are_not_sent(lab: Lab) -> None:
    lab.spoil("avoider", "avoid", active)
    lab.fly("\n  - climb: {agents: cf1}\n  - wait: {agents: cf1, seconds: 1}")
    assert any(sent.active[0] for _, sent in lab.robots.sent)
    assert not any(sent.active[1] for _, sent in lab.robots.sent)


def test_flying_agents_omitted_by_the_planner_are_braked(lab: Lab) -> None:
    lab.spoil("planner", "plan", lambda right, *args: only_first(right(*args)))
    lab.fly(PLACES)
    both = [sent for _, sent in lab.robots.sent if sent.active.all()]
    assert any(sent.velocity[0].any() for sent in both)
    assert not any(sent.velocity[1].any() for sent in both)


def only_first(plan: Plan) -> Plan:
    return replace(plan, setpoint=replace(plan.setpoint, active=plan.setpoint.active & FIRST))


def test_flying_agents_omitted_by_the_avoider_are_braked(lab: Lab) -> None:
    lab.spoil(
        "avoider", "avoid", lambda _right, _now, planned: replace(planned, active=[False] * 2)
    )
    lab.fly(IN_THE_AIR)
    assert any(sent.active.all() for _, sent in lab.robots.sent)
    assert not any(sent.velocity.any() for _, sent in lab.robots.sent)


def test_excessive_avoider_velocities_are_scaled(lab: Lab) -> None:
    lab.spoil(
        "avoider", "avoid", lambda _r, _now, planned: replace(planned, velocity=[[3, 0, 4]] * 2)
    )
    lab.fly(IN_THE_AIR)
    sent = next(sent for _, sent in lab.robots.sent if sent.active.all())
    assert sent.velocity == pytest.approx(np.array([[0.3, 0.0, 0.4]] * 2))


def test_what_the_core_corrects_is_reported_once_and_counted(lab: Lab) -> None:
    def rush(avoid: Any, estimate: Estimate, planned: Setpoint) -> Setpoint:
        answer: Setpoint = avoid(estimate, planned)
        return replace(answer, velocity=answer.velocity + np.array([3.0, 0.0, 0.0]))

    lab.spoil("avoider", "avoid", rush)
    summary = lab.fly("\n  - climb: {}\n  - wait: {seconds: 0.5}\n  - descend: {}")
    assert lab.said("corrected") == [
        "cf1 is slowed to the speed limit",
        "cf2 is slowed to the speed limit",
    ]
    corrected = [tick.corrected.speed.sum() for tick in lab.ticks]
    assert summary["corrected"]["speed"] == sum(corrected) > 5


def test_ticks_that_are_missed_are_left_out(lab: Lab) -> None:
    asked: list[float] = []

    def oversleep(right: Callable[[float], float], until: float) -> float:
        asked.append(until)
        return right(until + 0.25 if len(asked) == 15 else until)

    lab.spoil("transport", "wait", oversleep)
    lab.fly()
    late = asked[14]
    assert asked[15:17] == pytest.approx([late + 0.3, late + 0.4])
    assert np.diff(asked).min() == pytest.approx(0.1)


def test_unlocated_agents_land_from_finite_heights(lab: Lab) -> None:
    lab.spoil("localizer", "locate", lambda right, *args: nowhere(right(*args)), FLYING)
    lab.fly()
    landings = [command for _, command in lab.robots.commands if command.order is Order.LAND]
    assert sorted(lab.ordered(Order.LAND)) == [0, 1]
    assert all(np.isfinite(landing.position).all() for landing in landings)


def nowhere(estimate: Estimate) -> Estimate:
    """Say of the second agent that nothing is known."""
    gone = np.array([0.0, np.nan])
    frames = estimate.map_from_odom
    return replace(
        estimate,
        position=estimate.position + gone[:, None],
        velocity=estimate.velocity + gone[:, None],
        yaw=estimate.yaw + gone,
        valid=FIRST,
        map_from_odom=replace(frames, yaw=frames.yaw + gone),
    )


def test_landing_from_unknown_height_allows_for_the_maximum(lab: Lab) -> None:
    def lower(right: Callable[..., Estimate], telemetry: Telemetry) -> Estimate:
        unknown = np.array([0.0, np.nan])[:, None]
        estimate = right(telemetry)
        return replace(estimate, position=estimate.position + unknown, valid=FIRST)

    lab.spoil("localizer", "locate", lower, FLYING)
    mission = lab.load()
    lab.fly()
    (landing,) = (c for _, c in lab.robots.commands if c.order is Order.LAND and 1 in c.agent)
    (duration,) = landing.duration[landing.agent == 1]
    assert duration >= mission.scene.limits.height[1] / LAND_SPEED - 1e-9


def test_keyboard_interrupts_land_all_agents(lab: Lab) -> None:
    lab.spoil("planner", "plan", KeyboardInterrupt(), FLYING)
    with pytest.raises(KeyboardInterrupt):
        lab.fly()
    assert [lab.went(name)[-1] for name in lab.swarm] == ["landed", "landed"]
    assert lab.closed["transport"] == 1
    assert len(lab.summaries) == 1


def test_a_flight_that_fails_at_once_has_a_summary(lab: Lab) -> None:
    lab.spoil("transport", "receive", BOOM)
    summary = lab.fly()
    assert summary["outcome"] == "failed"
    assert summary["flight_time_s"] == 0.0
    assert summary["min_separation_m"] is None
    assert "position_mse_m2" not in summary  # no observer has seen a tick


def test_interrupts_while_landing_still_record_an_outcome(lab: Lab) -> None:
    lab.spoil("transport", "receive", KeyboardInterrupt(), FLYING)
    with pytest.raises(KeyboardInterrupt):
        lab.fly()
    assert [summary["outcome"] for summary in lab.summaries] == ["aborted"]
    assert lab.closed["transport"] == 1
