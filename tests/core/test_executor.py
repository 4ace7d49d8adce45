"""Steps: one after the other, at once, again; and what happens when one fails."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import Estimate, Goals, Order, Plan, Status, TaskOutput, Telemetry
from star_core.toolkit import Refusal
from tests.core.conftest import Lab, heard

BOOM = RuntimeError("boom")


def silent(row: int, since: float, until: float, age: float = 0.6) -> Callable[..., Telemetry]:
    """An agent is heard last `age` seconds ago between two mission times, s."""

    def ages(now: Telemetry) -> dict[str, Any]:
        late = age if since < now.time < until else 0.0
        return {"age": np.where(np.arange(len(now.age)) == row, late, 0.0)}

    return heard(ages)


def began(lab: Lab) -> list[tuple[float, str]]:
    """When each step began, s, and what began."""
    return [
        (round(event.time, 6), event.text.partition(" ")[2])
        for event in lab.events
        if event.kind == "step" and event.text.endswith(" begins")
    ]


def failure(lab: Lab) -> str:
    """The only failure of a step on record, without its location in the file."""
    (text,) = (text for text in lab.said("failure") if " failed: " in text)
    return text.partition(" ")[2]


def rising(speed: float) -> Callable[..., Estimate]:
    """Every agent is estimated to climb, m/s."""

    def wrong(right: Callable[[Telemetry], Estimate], telemetry: Telemetry) -> Estimate:
        estimate = right(telemetry)
        return replace(estimate, velocity=np.tile([0.0, 0, speed], (len(estimate.yaw), 1)))

    return wrong


# Agents that take off


@pytest.mark.parametrize(("speed", "flying"), [(0.05, 1.0), (0.2, 3.0), (-0.2, 3.0)])
def test_takeoff_ends_at_rest_or_two_seconds_after_the_commander(
    lab: Lab, speed: float, flying: float
) -> None:
    lab.spoil("localizer", "locate", rising(speed))
    lab.fly()
    begun, ended = (
        next(time for time, name, phase in lab.phases if (name, phase) == ("cf1", target))
        for target in ("taking_off", "flying")
    )
    assert ended - begun == pytest.approx(flying, abs=0.11)


# Agents that are lost


@pytest.mark.parametrize(("age", "lost"), [(0.5, False), (0.51, True), (np.nan, True)])
def test_agents_are_lost_after_half_a_second_without_reports(
    lab: Lab,
    age: float,
    lost: bool,  # noqa: FBT001 -- what is expected
) -> None:
    lab.spoil("transport", "receive", silent(1, 1.5, 2.5, age))
    lab.fly()
    assert ("lost" in lab.went("cf2")) is lost
    assert ("cf2 is lost" in lab.said("failure")) is lost


def test_losing_an_agent_fails_its_step_and_lands_all_agents(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(1, 1.5, 2.5))
    summary = lab.fly()
    assert summary["outcome"] == "failed"
    assert summary["reason"].endswith(":12 wait cf1, cf2 failed: cf2 is lost")
    assert sorted(lab.ordered(Order.LAND)) == [0, 1]
    assert lab.went("cf2") == ["taking_off", "flying", "lost", "landing", "landed"]


def test_a_step_fails_when_one_of_its_agents_is_not_located(lab: Lab) -> None:
    lab.spoil(
        "localizer", "locate", lambda right, *args: replace(right(*args), valid=[True, False]),
        range(20, 30),
    )  # fmt: skip
    assert lab.fly()["reason"].endswith("wait cf1, cf2 failed: cf2 is lost")


def test_agents_recovered_before_their_next_step_go_on(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(1, 1.5, 2.5))
    summary = lab.fly(
        "\n  - climb: {}\n  - wait: {agents: cf1, seconds: 2}"
        "\n  - visit: {agents: cf2, to: [0, 2, 1]}\n  - descend: {}"
    )
    assert summary["outcome"] == "completed"
    assert lab.went("cf2") == ["taking_off", "flying", "lost", "flying", "landing", "landed"]


def test_agents_that_stay_lost_end_the_mission(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(1, 1.5, 7.0))
    summary = lab.fly("\n  - climb: {}\n  - wait: {agents: cf1, seconds: 20}\n  - descend: {}")
    assert (summary["outcome"], summary["reason"]) == ("failed", "cf2 is lost")
    (landed,) = {time for time, c in lab.robots.commands if c.order is Order.LAND and 1 in c.agent}
    assert landed < 1.5 + 0.5 + 1.0 + 0.3  # silence, then lost, then patience


def test_a_step_for_an_agent_that_is_lost_fails_at_once(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(1, 1.5, 7.0))
    summary = lab.fly(
        "\n  - climb: {}\n  - wait: {agents: cf1, seconds: 1}\n  - wait: {agents: cf2, seconds: 1}"
    )
    assert summary["reason"].endswith("mission.yaml:13 wait cf2 failed: cf2 is lost")


# Steps that fail: `wait` with `fails` says so itself, `limit` is how long it says it takes.

FAILING = [
    ("seconds: 1, fails: no film", "no film"),
    ("seconds: 9, timeout: 1", "timed out after 1 s"),
    ("seconds: 9, limit: 2", "timed out after 2 s"),
]


@pytest.mark.parametrize(("options", "why"), FAILING, ids=["says so", "given", "derived"])
def test_a_step_that_fails_aborts_the_mission_by_default(lab: Lab, options: str, why: str) -> None:
    summary = lab.fly(f"\n  - climb: {{}}\n  - wait: {{{options}}}\n  - visit: {{to: [1, 1, 1]}}")
    assert summary["outcome"] == "failed"
    assert summary["reason"].endswith(f"mission.yaml:12 wait cf1, cf2 failed: {why}")
    assert [what for _, what in began(lab)] == ["climb cf1, cf2 begins", "wait cf1, cf2 begins"]
    assert [lab.went(name)[-1] for name in lab.swarm] == ["landed", "landed"]


@pytest.mark.parametrize(("options", "why"), FAILING, ids=["says so", "given", "derived"])
def test_failed_steps_with_on_failure_land_leave_others_flying(
    lab: Lab, options: str, why: str
) -> None:
    summary = lab.fly(
        f"\n  - climb: {{}}\n  - wait: {{agents: cf2, {options}, on_failure: land}}"
        "\n  - visit: {agents: cf1, to: [2, 0, 1]}"
    )
    assert failure(lab) == f"wait cf2 failed: {why}; on_failure: land"
    assert summary["outcome"] == "completed"
    assert lab.ordered(Order.LAND) == [1, 0]
    assert lab.ticks[-1].estimate.position[:, 0] == pytest.approx([2.0, 0.0])


@pytest.mark.parametrize(("options", "why"), FAILING, ids=["says so", "given", "derived"])
def test_a_step_that_fails_is_passed_over_if_configured(lab: Lab, options: str, why: str) -> None:
    summary = lab.fly(
        f"\n  - climb: {{}}\n  - wait: {{{options}, on_failure: continue}}"
        "\n  - visit: {agents: cf1, to: [1, 1, 1]}\n  - descend: {}"
    )
    assert failure(lab) == f"wait cf1, cf2 failed: {why}; on_failure: continue"
    assert summary["outcome"] == "completed"
    assert [what for _, what in began(lab)][2:] == ["visit cf1 begins", "descend cf1, cf2 begins"]
    assert [(s["verb"], s["agents"], s["outcome"]) for s in summary["steps"]] == [
        ("climb", ["cf1", "cf2"], "success"),
        ("wait", ["cf1", "cf2"], "failure"),
        ("visit", ["cf1"], "success"),
        ("descend", ["cf1", "cf2"], "success"),
    ]
    ends = [(s["begun_s"], s["ended_s"]) for s in summary["steps"]]
    assert all(begun <= ended for begun, ended in ends)
    assert [begun for begun, _ in ends[1:]] == [ended for _, ended in ends[:-1]]


def test_unreachable_goals_fail_only_their_own_step(lab: Lab) -> None:
    def nowhere(plan: Any, estimate: Estimate, goals: Goals) -> Plan:
        answer: Plan = plan(estimate, goals)
        far = goals.active & (goals.position[:, 0] > 5)
        return replace(answer, unreachable=far, reasons={1: "a wall"})

    lab.spoil("planner", "plan", nowhere)
    summary = lab.fly(
        "\n  - climb: {}\n  - visit: {agents: cf2, to: [9, 0, 1], on_failure: continue}"
        "\n  - visit: {agents: cf2, to: [1, 1, 1]}"
    )
    assert failure(lab) == ("visit cf2 failed: cf2 cannot get there: a wall; on_failure: continue")
    assert summary["outcome"] == "completed"
    assert [s["outcome"] for s in summary["steps"]] == ["success", "failure", "success"]


def test_refused_orders_fail_the_step_with_their_reason(lab: Lab) -> None:
    left = [Refusal(1, "refuses to climb: it is blocked")]

    says = heard(lambda now: {"refusals": (left.pop(),) if left and now.state[1] else ()})
    lab.spoil("transport", "receive", says)
    steps = "\n  - climb: {agents: cf2, on_failure: continue}\n  - wait: {seconds: 2}"
    summary = lab.fly(steps)
    assert failure(lab) == (
        "climb cf2 failed: cf2 refuses to climb: it is blocked; on_failure: continue"
    )
    assert ("refused", "cf2 refuses to climb: it is blocked", "cf2") in {
        (event["kind"], event["text"], event.get("agent")) for event in summary["events"]
    }
    assert [s["outcome"] for s in summary["steps"]] == ["failure", "success"]


def test_a_refusal_of_no_agent_is_the_transports_fault(lab: Lab) -> None:
    lab.spoil("transport", "receive", heard(lambda _now: {"refusals": ((2, "no"),)}))
    summary = lab.fly()
    assert summary["outcome"] != "completed"
    assert "Telemetry.refusals has agent 2 of 2" in summary["reason"]


def test_a_time_out_that_is_given_goes_before_the_derived_one(lab: Lab) -> None:
    summary = lab.fly("\n  - climb: {}\n  - wait: {seconds: 3, limit: 1, timeout: 5}")
    assert summary["outcome"] == "completed"


def test_a_step_that_is_done_in_the_tick_of_its_time_out_is_done(lab: Lab) -> None:
    assert lab.fly("\n  - wait: {seconds: 2, timeout: 2}")["outcome"] == "completed"


def test_a_step_that_fails_without_a_reason_is_reported_so(lab: Lab) -> None:
    lab.spoil("wait", "step", lambda *_: TaskOutput(status=Status.FAILURE))
    assert lab.fly()["reason"].endswith("wait cf1, cf2 failed: failed and gave no reason")


@pytest.mark.parametrize("then", ["land", "continue"])
def test_lost_agents_leave_and_land_if_the_step_allows_it(lab: Lab, then: str) -> None:
    lab.spoil("transport", "receive", silent(1, 1.5, 2.5))
    summary = lab.fly(
        f"\n  - climb: {{}}\n  - wait: {{seconds: 2, on_failure: {then}}}"
        "\n  - visit: {to: [0, 0, 1]}\n  - descend: {}"
    )
    assert summary["outcome"] == "completed"
    assert lab.went("cf2")[-3:] == ["lost", "landing", "landed"]
    assert failure(lab) == f"wait cf1, cf2 failed: cf2 is lost; on_failure: {then}"


def test_steps_go_on_with_the_agents_that_are_left(lab: Lab) -> None:
    lab.spoil("transport", "receive", silent(1, 1.5, 2.5))
    lab.fly(
        "\n  - climb: {}\n  - wait: {seconds: 2, on_failure: continue}"
        "\n  - visit: {to: [0, 0, 1]}\n  - visit: {to: [0, 0, 1], agents: cf2}"
    )
    assert [what for _, what in began(lab)][2:] == ["visit cf1 begins"]
    assert lab.said("step")[-1].endswith("visit skipped: no agent is left for it")


def test_tolerated_emergencies_do_not_fail_the_mission(lab: Lab) -> None:
    tumbled = heard(lambda now: {"state": now.state | [0, 32 if now.time > 2 else 0]})
    lab.spoil("transport", "receive", tumbled)
    summary = lab.fly("\n  - climb: {}\n  - wait: {seconds: 2, on_failure: continue}")
    assert lab.went("cf2")[-1] == "emergency"
    assert summary["outcome"] == "completed"


# Steps at once, again, and in each other


def test_steps_run_one_after_the_other(lab: Lab) -> None:
    lab.fly("\n  - wait: {seconds: 1}\n  - wait: {seconds: 0.5}\n  - wait: {seconds: 0.2}")
    assert [time for time, _ in began(lab)] == [0.0, 1.0, 1.5]


def test_parallel_is_over_when_all_its_steps_are(lab: Lab) -> None:
    lab.fly(
        "\n  - parallel: [{wait: {agents: cf1, seconds: 1}}, {wait: {agents: cf2, seconds: 2}}]"
        "\n  - wait: {seconds: 0.1}"
    )
    assert [time for time, _ in began(lab)] == [0.0, 0.0, 2.0]


def test_parallel_steps_fly_their_agents_to_their_goals_at_once(lab: Lab) -> None:
    lab.fly(
        "\n  - climb: {}\n  - parallel: [{visit: {agents: cf1, to: [1, 0, 1]}}, "
        "{visit: {agents: cf2, to: [0, 2, 1]}}]\n  - wait: {seconds: 0.1}"
    )
    assert lab.ticks[-1].estimate.position[:, :2].tolist() == [
        pytest.approx([1, 0]),
        pytest.approx([0, 2]),
    ]
    both = [tick for tick in lab.ticks if tick.doing == "visit cf1, visit cf2"]
    assert all(tick.goals.active.all() for tick in both)
    assert both


def test_a_failure_in_parallel_aborts_the_steps_beside_it(lab: Lab) -> None:
    summary = lab.fly(
        "\n  - parallel: [{wait: {agents: cf1, seconds: 5}}, "
        "{wait: {agents: cf2, seconds: 1, fails: no film}}]"
    )
    assert summary["reason"].endswith("mission.yaml:11 wait cf2 failed: no film")
    assert summary["flight_time_s"] == pytest.approx(1.0)


@pytest.mark.parametrize("then", ["land", "continue"])
def test_tolerated_failures_leave_parallel_steps_alone(lab: Lab, then: str) -> None:
    summary = lab.fly(
        "\n  - climb: {}\n  - parallel: [{wait: {agents: cf1, seconds: 3}}, "
        f"{{wait: {{agents: cf2, seconds: 1, fails: no film, on_failure: {then}}}}}]"
    )
    assert summary["outcome"] == "completed"
    assert lab.said("step")[-1].endswith("mission.yaml:12 wait cf1 done")
    assert lab.ordered(Order.LAND)[0] == (1 if then == "land" else 0)


def test_repeat_runs_its_steps_as_often_as_given(lab: Lab) -> None:
    lab.fly("\n  - repeat: {times: 3, steps: [{wait: {seconds: 0.5}}, {wait: {seconds: 0.2}}]}")
    assert len(began(lab)) == 6
    assert sum(text.endswith(" done") for text in lab.said("step")) == 6


def test_a_failure_in_repeat_aborts_the_rounds_that_are_left(lab: Lab) -> None:
    lab.fly("\n  - repeat: {times: 3, steps: [{wait: {seconds: 0.5, fails: no film}}]}")
    assert len(began(lab)) == 1


def test_tolerated_failures_in_repeat_go_on_to_the_next_round(lab: Lab) -> None:
    step = "wait: {seconds: 0.5, fails: no film, on_failure: continue}"
    summary = lab.fly(f"\n  - repeat: {{times: 3, steps: [{{{step}}}]}}")
    assert len(began(lab)) == 3
    assert summary["outcome"] == "completed"


def test_a_round_without_time_takes_a_tick(lab: Lab) -> None:
    lab.fly("\n  - repeat: {times: 4, steps: [{wait: {seconds: 0}}]}")
    assert [time for time, _ in began(lab)] == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_repeat_and_parallel_stand_in_each_other(lab: Lab) -> None:
    inner = "repeat: {times: 2, steps: [{wait: {agents: cf1, seconds: 0.5}}]}"
    beside = "wait: {agents: cf2, seconds: 0.3}"
    lab.fly(
        f"\n  - repeat: {{times: 2, steps: [{{parallel: [{{{inner}}}, {{{beside}}}]}}]}}"
        "\n  - wait: {seconds: 0.1}"
    )
    whose = [what.removeprefix("wait ").removesuffix(" begins") for _, what in began(lab)]
    assert whose == [
        "cf1 [1/2] [1/2]",
        "cf2 [1/2]",
        "cf1 [1/2] [2/2]",
        "cf1 [2/2] [1/2]",
        "cf2 [2/2]",
        "cf1 [2/2] [2/2]",
        "cf1, cf2",
    ]
    first = lab.events[0]
    assert first.agent == "cf1"
    assert first.details is not None
    assert (first.details["verb"], first.details["rounds"]) == ("wait", [[1, 2], [1, 2]])


@pytest.mark.parametrize(
    ("when", "seconds"),
    [("{time: 0.4}", 0.2), ("{time: 0.6}", 0.3), ("{event: step, agents: cf2}", 0.2),
     ("{event: failure}", 0.3), ("{near: {agent: cf2, within: 0.1}, agents: cf1}", 0.3)],
)  # fmt: skip
def test_a_condition_chooses_steps_when_they_are_reached(
    lab: Lab, when: str, seconds: float
) -> None:
    branches = "then: [wait: {seconds: 0.2}], else: [wait: {seconds: 0.3}]"
    summary = lab.fly(f"\n  - wait: {{seconds: 0.5}}\n  - if: {{when: {when}, {branches}}}")
    first, chosen = summary["steps"]
    assert chosen["begun_s"] == first["ended_s"]
    assert chosen["ended_s"] - chosen["begun_s"] == pytest.approx(seconds)
    (text,) = (text for text in lab.said("step") if " if " in text)
    assert text.endswith(": yes" if seconds == 0.2 else ": no")


def test_a_choice_in_each_is_about_its_agent_and_may_be_empty(lab: Lab) -> None:
    choice = "if: {when: {event: step}, then: [wait: {seconds: 0.2}]}"
    near = "if: {when: {battery_below: 0.1}, then: [wait: {seconds: 0.2}]}"
    summary = lab.fly(f"\n  - each: {{steps: [{choice}, {near}]}}")
    assert summary["outcome"] == "completed"
    assert [step["agents"] for step in summary["steps"]] == [["cf2"]]  # cf1 was before any step


WAITS = "\n  - wait: {seconds: 1}\n  - wait: {seconds: 1}"


def reacts(*reactions: tuple[str, str]) -> str:
    """The reactions of a mission."""
    listed = [f"  - {{when: {when}, then: [{steps}]}}\n" for when, steps in reactions]
    return "on:\n" + "".join(listed)


def order(summary: dict[str, Any]) -> list[tuple[Any, ...]]:
    """The steps of a flight: agents, begin, end and outcome."""
    return [
        (step["agents"], round(step["begun_s"], 2), round(step["ended_s"], 2), step["outcome"])
        for step in summary["steps"]
    ]


def test_a_reaction_replaces_what_its_agents_do(lab: Lab) -> None:
    more = reacts(("{time: 0.5}", "wait: {agents: cf1, seconds: 3}"))
    summary = lab.fly(WAITS, more=more)
    assert summary["outcome"] == "completed"
    assert order(summary) == [
        (["cf1", "cf2"], 0.0, 1.5, "success"),  # the task of the one that stays is a new one
        (["cf1"], 0.5, 3.5, "success"),
        (["cf2"], 1.5, 2.5, "success"),
    ]


def test_a_step_whose_agents_all_react_is_over(lab: Lab) -> None:
    summary = lab.fly(WAITS, more=reacts(("{time: 0.5}", "wait: {seconds: 2}")))
    assert summary["outcome"] == "completed"
    assert order(summary) == [
        (["cf1", "cf2"], 0.0, 0.5, "aborted"),
        (["cf1", "cf2"], 0.5, 2.5, "success"),
    ]
    assert lab.said("failure") == []


def test_a_reaction_comes_once_and_only_while_steps_run(lab: Lab) -> None:
    more = reacts(("{event: step}", "wait: {agents: cf1, seconds: 0.1}"),
                  ("{time: 30}", "wait: {seconds: 0.1}"))  # fmt: skip
    summary = lab.fly(WAITS, more=more)
    assert summary["outcome"] == "completed"
    assert [step["agents"] for step in summary["steps"]].count(["cf1"]) == 1
    assert len([text for text in lab.said("step") if " on " in text]) == 1


@pytest.mark.parametrize(("first", "second"), [(0.5, 0.8), (0.8, 0.5), (0.5, 0.5)])
def test_the_first_reaction_that_is_listed_goes_before_others(
    lab: Lab, first: float, second: float
) -> None:
    more = reacts((f"{{time: {first}}}", "wait: {agents: cf1, seconds: 3}"),
                  (f"{{time: {second}}}", "wait: {seconds: 1}"))  # fmt: skip
    summary = lab.fly(WAITS, more=more)
    assert summary["outcome"] == "completed"
    assert (["cf1"], first, first + 3, "success") in order(summary)


def test_of_a_reaction_for_the_first_only_one_agent_reacts(lab: Lab) -> None:
    steps = "wait: {seconds: 3}, wait: {seconds: 1}"
    summary = lab.fly(WAITS, more=reacts(("{time: 0.5}, agents: first", steps)))
    assert summary["outcome"] == "completed"
    assert order(summary) == [
        (["cf1", "cf2"], 0.0, 1.5, "success"),
        (["cf1"], 0.5, 3.5, "success"),
        (["cf2"], 1.5, 2.5, "success"),
        (["cf1"], 3.5, 4.5, "success"),
    ]


def test_the_first_agent_is_one_for_which_the_condition_holds(lab: Lab) -> None:
    near = "{near: {point: [0, 1, 0], within: 0.6}}, agents: first"
    summary = lab.fly(WAITS, more=reacts((near, "wait: {seconds: 3}")))
    assert [step["agents"] for step in summary["steps"]].count(["cf2"]) == 1


def test_a_reaction_that_fails_aborts_the_mission(lab: Lab) -> None:
    more = reacts(("{time: 0.5}", "wait: {agents: cf1, seconds: 0.2, fails: no film}"))
    summary = lab.fly(WAITS, more=more)
    assert summary["outcome"] == "failed"
    assert "no film" in summary["reason"]


def test_a_reaction_without_agents_in_the_mission_does_nothing(lab: Lab) -> None:
    more = reacts(("{event: safety}", "wait: {seconds: 5}"))
    assert [step["agents"] for step in lab.fly(WAITS, more=more)["steps"]] == [["cf1", "cf2"]] * 2


def test_a_step_that_is_repeated_begins_with_a_new_task(lab: Lab) -> None:
    made: list[Any] = []

    def make(right: Callable[..., Any], *args: Any, **options: Any) -> Any:
        made.append(right(*args, **options))
        return made[-1]

    lab.spoil("wait", "make", make)
    lab.fly("\n  - repeat: {times: 3, steps: [{wait: {seconds: 0.5}}]}")
    assert len(set(map(id, made))) == 3


def test_all_agents_land_when_a_task_cannot_be_made_again(lab: Lab) -> None:
    lab.spoil("wait", "make", BOOM, range(1, 2))
    summary = lab.fly("\n  - climb: {}\n  - repeat: {times: 2, steps: [{wait: {seconds: 0.5}}]}")
    assert summary["outcome"] == "failed"
    assert summary["reason"].startswith("task 'wait' (their-dist 1.2:lab): RuntimeError: boom")
    assert [lab.went(name)[-1] for name in lab.swarm] == ["landed", "landed"]


def test_feed_forward_velocities_hold_for_one_tick(lab: Lab) -> None:
    def once(_right: object, now: Estimate, _health: object) -> TaskOutput:
        velocity = np.full((2, 3), 0.1)
        goals = Goals(now.position, velocity, now.yaw, np.full(2, 0.5), np.ones(2, np.bool_))
        return TaskOutput(goals if now.time < 1.25 else None, status=Status.RUNNING)

    lab.spoil("wait", "step", once)
    lab.fly("\n  - climb: {}\n  - wait: {seconds: 1, timeout: 0.5}")
    velocities = [(t.time, t.goals.velocity[0, 0]) for t in lab.ticks if t.doing.startswith("wait")]
    assert [velocity for _, velocity in velocities] == [
        0.1 * (time < 1.25) for time, _ in velocities
    ]


def test_an_agent_without_a_step_holds_its_place(lab: Lab) -> None:
    lab.fly(
        "\n  - climb: {}\n  - visit: {agents: cf2, to: [0, 2, 1]}"
        "\n  - wait: {agents: cf1, seconds: 1}"
    )
    held = [tick.goals.position[1] for tick in lab.ticks if tick.doing == "wait cf1"]
    assert np.array(held) == pytest.approx(np.tile([0.0, 2.0, 1.0], (len(held), 1)))


# Conditions that end a step


def test_a_step_is_over_and_a_success_once_its_condition_holds(lab: Lab) -> None:
    summary = lab.fly("\n  - climb: {}\n  - wait: {seconds: 9, until: {elapsed: 2}}")
    (wait,) = (step for step in summary["steps"] if step["verb"] == "wait")
    assert wait["outcome"] == "success"
    assert wait["ended_s"] - wait["begun_s"] == pytest.approx(2.0)


def test_a_step_that_is_done_does_not_wait_for_its_condition(lab: Lab) -> None:
    summary = lab.fly("\n  - climb: {}\n  - wait: {seconds: 1, until: {elapsed: 9}}")
    assert summary["steps"][1]["ended_s"] - summary["steps"][1]["begun_s"] < 2


def test_a_step_may_take_as_long_as_its_condition_waits(lab: Lab) -> None:
    summary = lab.fly("\n  - climb: {}\n  - wait: {seconds: 99, limit: 2, until: {elapsed: 4}}")
    assert summary["steps"][1]["outcome"] == "success"


def test_a_condition_that_never_holds_ends_with_the_time_out(lab: Lab) -> None:
    summary = lab.fly(
        "\n  - climb: {}\n  - wait: {seconds: 9, timeout: 1, until: {event: refused}}"
    )
    assert "wait cf1, cf2 failed: timed out after 1 s" in summary["reason"]


# Each agent by itself


def test_each_runs_agents_independently(lab: Lab) -> None:
    summary = lab.fly(
        "\n  - climb: {}\n  - each:\n      steps:"
        "\n        - visit: {to: [1, 0, 1]}\n        - wait: {seconds: 1}\n  - descend: {}"
        "\nlimits: {separation: 0}\ncollisions: record"
    )
    assert summary["outcome"] == "completed"
    visits = {s["agents"][0]: s for s in summary["steps"] if s["verb"] == "visit"}
    waits = {s["agents"][0]: s for s in summary["steps"] if s["verb"] == "wait"}
    assert set(visits) == set(waits) == {"cf1", "cf2"}
    first, last = sorted(visits.values(), key=lambda step: step["ended_s"])
    assert waits[first["agents"][0]]["begun_s"] < last["ended_s"]


def test_each_is_for_the_agents_that_it_names(lab: Lab) -> None:
    lab.fly("\n  - climb: {}\n  - each: {agents: cf2, steps: [wait: {seconds: 1}]}")
    assert ("wait cf2 begins") in [what for _, what in began(lab)]
    assert ("wait cf1 begins") not in [what for _, what in began(lab)]


def test_a_step_times_out_though_nothing_is_heard_of_anybody(lab: Lab) -> None:
    lab.spoil("transport", "receive", heard(lambda now: {"time": min(now.time, 3.0)}))
    summary = lab.fly("\n  - climb: {}\n  - wait: {seconds: 9, timeout: 4}")
    assert summary["reason"].endswith("wait cf1, cf2 failed: timed out after 4 s")


def test_unfinished_steps_of_a_failed_mission_are_aborted(lab: Lab) -> None:
    short, long = "wait: {agents: cf1, seconds: 1, fails: tired}", "wait: {agents: cf2, seconds: 9}"
    summary = lab.fly(f"\n  - climb: {{}}\n  - parallel:\n      - {short}\n      - {long}")
    _, failed, aborted = summary["steps"]
    assert (failed["outcome"], aborted["outcome"]) == ("failure", "aborted")
    assert aborted["ended_s"] == failed["ended_s"]
