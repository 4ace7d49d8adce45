"""Parts that misbehave: whatever one does, it is named, and all agents land."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeAlias

import numpy as np
import pytest

from star_core import (
    AvoiderSpec,
    Command,
    Corrections,
    Goals,
    Image,
    Order,
    PluginError,
    PoseFixes,
    Registry,
    Setpoint,
    TaskOutput,
    Truth,
    fly,
    hookimpl,
    load,
)
from star_core.discovery import Source
from star_core.messages.telemetry import UNLABELLED
from star_core.pipeline import PluginPipeline
from tests.core.conftest import Lab
from tests.core.robots import Robots

Wrong: TypeAlias = BaseException | Callable[..., Any]

NAMED = {
    "transport": "transport 'robots' (their-dist 1.2:lab)",
    "localizer": "localizer 'seer' (their-dist 1.2:lab)",
    "planner": "planner 'dash' (their-dist 1.2:lab)",
    "avoider": "avoider 'idle' (their-dist 1.2:lab)",
    "wait": "task 'wait' (their-dist 1.2:lab)",
}
PIPELINE_KINDS = ("transport", "localizer", "planner", "avoider")
FLYING = range(20, 10**6)  # calls: the agents fly from the 11th tick to the 31st
ONCE = range(20, 21)
BOOM = RuntimeError("boom")
NAN = np.full((2, 3), np.nan)
ROW = np.array([0])
FOUR = np.zeros((4, 3))
FOR_FOUR = Setpoint(FOUR, FOUR[:, 0], FOUR[:, 0] > 0)
ALL = np.array([True, True])
ODD: Any = "done"


def change(**values: Any) -> Wrong:
    """Answer what is right, with other values."""
    return lambda right, *args: replace(right(*args), **values)


def brought_down(lab: Lab) -> bool:
    """Return whether all agents were commanded to land, and did."""
    ordered = {0, 1} <= set(lab.ordered(Order.LAND))
    return ordered and bool((Robots.receive(lab.robots).position[:, 2] == 0).all())


@pytest.mark.parametrize("role", NAMED)
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (BOOM, "RuntimeError: boom ("),
        (PluginError("no camera"), "no camera"),
        (SystemExit("bye"), "SystemExit: bye ("),
        (BaseException("panic"), "BaseException: panic ("),
        (lambda *_, **__: 3, "int has no "),
    ],
    ids=["raises", "raises STAR's own", "exits", "panics", "makes something else"],
)
def test_plugins_that_cannot_be_made_are_named_before_any_motion(
    lab: Lab, role: str, wrong: Wrong, message: str
) -> None:
    lab.spoil(role, "make", wrong)
    with pytest.raises(PluginError) as caught:
        lab.fly()
    assert str(caught.value).startswith(f"{NAMED[role]}: {message}")
    assert lab.ticks == []
    assert role == "transport" or (lab.robots.commands, lab.robots.sent) == ([], [])


@pytest.mark.parametrize("role", NAMED)
def test_plugins_already_made_are_closed_if_the_next_fails(lab: Lab, role: str) -> None:
    lab.spoil(role, "make", BOOM)
    with pytest.raises(PluginError):
        lab.fly()
    made = [
        kind
        for kind in PIPELINE_KINDS
        if role == "wait" or PIPELINE_KINDS.index(kind) < PIPELINE_KINDS.index(role)
    ]
    assert {kind: lab.closed[kind] for kind in PIPELINE_KINDS} == {
        k: int(k in made) for k in PIPELINE_KINDS
    }


def test_failing_links_are_reported_and_all_plugins_closed(lab: Lab) -> None:
    lab.spoil("transport", "connect", PluginError("cannot reach cf2 [plugin-failed]"))
    with pytest.raises(PluginError) as caught:
        lab.fly()
    assert str(caught.value) == f"{NAMED['transport']}: cannot reach cf2 [plugin-failed]"
    assert lab.ticks == []
    assert {kind: lab.closed[kind] for kind in PIPELINE_KINDS} == dict.fromkeys(PIPELINE_KINDS, 1)


@pytest.mark.parametrize(
    ("role", "method", "calls"),
    [
        ("transport", "wait", ONCE),
        ("transport", "receive", FLYING),
        ("transport", "command", range(1, 2)),  # the order to land
        ("transport", "truth", FLYING),
        ("wait", "begin", None),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_plugins_raising_in_flight_are_named_and_all_agents_land(
    lab: Lab, role: str, method: str, calls: range | None
) -> None:
    lab.spoil(role, method, BOOM, calls)
    summary = lab.fly()
    assert summary["outcome"] == lab.went(None)[-1] == "failed"
    assert summary["reason"].startswith(f"{NAMED[role]}: RuntimeError: boom (")
    assert lab.said("failure")[0] == summary["reason"].partition("; ")[0]
    assert brought_down(lab)


def goals(n: int, *, active: tuple[bool, ...], speed: float = 0.5) -> Goals:
    zero = np.zeros(n)
    return Goals(np.zeros((n, 3)), np.zeros((n, 3)), zero, zero + speed, np.array(active))


def ordering(order: Any = Order.GOTO, duration: float = 1.0, x: float = 0.0) -> TaskOutput:
    """A step that orders the first agent to go somewhere."""
    ones = np.ones(1)
    return TaskOutput(commands=(Command(order, ROW, np.full((1, 3), x), ones, ones * duration),))


def answered(value: object) -> Wrong:
    """Answer something else than what is right."""
    return lambda *_: value


FOUR_ROWS = "every field of {} has 4 rows, expected 2"
FOUR_TRUE = Truth(0.0, FOUR, FOUR, np.zeros((4, 4)))
FOUR_HEARD = {
    **dict.fromkeys(("position", "velocity"), FOUR),
    **dict.fromkeys(("battery", "state", "age"), FOUR[:, 0]),
    "attitude": np.zeros((4, 4)),
}


@pytest.mark.parametrize(
    ("role", "method", "wrong", "message"),
    [
        ("transport", "wait", answered(None), "TypeError: float() argument must be"),
        *(("transport", "wait", answered(t), f"returned {t!r}") for t in (np.nan, np.inf, 0.0)),
        ("transport", "receive", answered(None), "returned NoneType, expected Telemetry"),
        ("transport", "receive", change(**FOUR_HEARD), FOUR_ROWS.format("Telemetry")),
        ("transport", "send", answered(FOR_FOUR), FOUR_ROWS.format("Setpoint")),
        ("transport", "truth", answered(FOR_FOUR), "returned Setpoint, expected Truth"),
        ("transport", "truth", answered(FOUR_TRUE), FOUR_ROWS.format("Truth")),
        ("localizer", "locate", change(yaw=[0, np.inf]), "Estimate.yaw of row 1 is inf, expected"),
        ("localizer", "locate", change(valid=[True]), "Estimate.valid has 1 row, but position"),
        ("localizer", "locate", change(messages=(7,)), "Estimate.messages is (7,), expected texts"),
        ("localizer", "locate", change(time=0.0), "Estimate.time is 0.0, expected"),
        (
            "planner",
            "plan",
            change(setpoint=FOR_FOUR, unreachable=[False] * 4),
            FOUR_ROWS.format("Setpoint"),
        ),
        ("planner", "plan", change(reasons=["no"]), "Plan.reasons is ['no'], expected a map fro"),
        ("avoider", "avoid", answered(FOR_FOUR), FOUR_ROWS.format("Setpoint")),
        ("avoider", "avoid", change(yaw=[0, np.nan]), "Setpoint.yaw of row 1 is nan, expected"),
        *(
            ("wait", "begin", answered(limit), f"begin() returned {limit!r}, expected the timeout")
            for limit in (None, np.inf, np.nan, -1.0)
        ),
        ("wait", "step", answered(TaskOutput(status=ODD)), "TaskOutput.status is 'done', expected"),
        (
            "wait",
            "step",
            lambda *_: TaskOutput(goals(2, active=(True, True), speed=-1.0)),
            "Goals.speed is [-1.0, -1.0], expec",
        ),
        ("wait", "step", lambda *_: ordering(duration=0.0), "Command.duration is [0.0], expected"),
        ("wait", "step", lambda *_: ordering(order="up"), "Command.order is 'up', expected an O"),
        ("wait", "step", lambda *_: ordering(x=np.nan), "Command.position is"),
    ],
)
def test_broken_contracts_name_the_plugin_and_land_all_agents(
    lab: Lab, role: str, method: str, wrong: Wrong, message: str
) -> None:
    lab.spoil(role, method, wrong, {"wait": None}.get(role, ONCE if method == "wait" else FLYING))
    summary = lab.fly()
    assert summary["outcome"] == "failed"
    assert summary["reason"].startswith(f"{NAMED[role]}: ")
    assert message in summary["reason"]
    assert brought_down(lab)


def test_wrong_row_counts_are_reported_for_every_field(lab: Lab) -> None:
    first = np.zeros((1, 3))
    lab.spoil("avoider", "avoid", lambda *_: Setpoint(first, np.zeros(2), ROW == 0), FLYING)
    assert lab.fly()["reason"] == (
        f"{NAMED['avoider']}: Setpoint.yaw has 2 rows, but velocity and active have 1; "
        "expected one row per agent [wrong-shape]"
    )
    assert brought_down(lab)


def test_plugins_with_wrong_signatures_are_reported_with_line(hop: Path) -> None:
    def of(make: Callable[..., Any]) -> str:
        plugin = SimpleNamespace(
            star_avoiders=hookimpl(lambda: [AvoiderSpec(name="odd", summary="Odd.", make=make)])
        )
        registry = Registry()
        registry.add(plugin, Source("their-dist:odd", "1.2"))
        with pytest.raises(PluginError) as caught:
            fly(load(hop / "hop.yaml", registry, ["avoider=odd"]), registry)
        return str(caught.value)

    whose, place = "avoider 'odd' (their-dist 1.2:odd)", f"({__file__}:"
    assert of(lambda scene, gain: (scene, gain)).startswith(
        f"{whose}: make(scene, gain) cannot be called as make(scene): missing a required argument: "
        f"'gain' {place}"
    )
    short = SimpleNamespace(avoid=lambda estimate: estimate)
    assert of(lambda _scene: short).startswith(
        f"{whose}: avoid(estimate) cannot be called as avoid(estimate, planned): too many "
        f"positional arguments {place}"
    )


@pytest.mark.parametrize("spoilt", [None, *PIPELINE_KINDS])
def test_every_part_is_closed_once_however_a_mission_ends(lab: Lab, spoilt: str | None) -> None:
    method = {"localizer": "locate", "planner": "plan", "avoider": "avoid", "transport": "wait"}
    if spoilt:
        lab.spoil(spoilt, method[spoilt], BOOM, FLYING)
    lab.fly()
    assert {kind: lab.closed[kind] for kind in PIPELINE_KINDS} == dict.fromkeys(PIPELINE_KINDS, 1)


def test_every_task_is_closed_once(lab: Lab) -> None:
    lab.fly()
    assert Counter({verb: lab.closed[verb] for verb in ("climb", "wait", "descend")}) == Counter(
        climb=1, wait=1, descend=1
    )


@pytest.mark.parametrize("wrong", [BOOM, SystemExit("bye")], ids=["raises", "exits"])
@pytest.mark.parametrize("role", PIPELINE_KINDS)
def test_plugins_failing_to_close_are_reported_and_others_closed(
    lab: Lab, role: str, wrong: Wrong
) -> None:
    lab.spoil(role, "close", wrong)
    summary = lab.fly()
    (text,) = lab.said("failure")
    assert text.startswith(f"{NAMED[role]}: {type(wrong).__name__}: {wrong} (")
    assert text in [event["text"] for event in summary["events"]]
    assert summary["outcome"] == "completed"
    assert {kind: lab.closed[kind] for kind in PIPELINE_KINDS} == {
        k: int(k != role) for k in PIPELINE_KINDS
    }


def test_avoiders_may_note_the_goals_of_each_tick(lab: Lab) -> None:
    noted: list[Goals] = []
    watcher = SimpleNamespace(avoid=lambda _, planned: planned, note_goals=noted.append)
    lab.spoil("avoider", "make", lambda *_: watcher)
    lab.fly()
    steered = [tick.goals for tick in lab.ticks if tick.goals.active.any()]
    flown = [goals for goals in noted if goals.active.any()]
    assert len(steered) == len(flown) > 0
    assert all(a is b for a, b in zip(steered, flown, strict=True))


def test_a_part_needs_no_close(lab: Lab) -> None:
    lab.spoil("avoider", "make", lambda *_: type("Bare", (), {"avoid": lambda _, __, w: w})())
    assert lab.fly()["outcome"] == "completed"


def test_messages_of_a_localizer_are_events_once(lab: Lab) -> None:
    lab.spoil("localizer", "locate", change(messages=("it sees nothing",)), ONCE)
    events = lab.fly()["events"]
    assert [each["text"] for each in events if each["kind"] == "estimate"] == ["it sees nothing"]


@pytest.mark.parametrize(("row", "fails"), [(UNLABELLED, False), (1, False), (2, True), (-2, True)])
def test_fixes_are_of_agents_or_of_none(lab: Lab, *, row: int, fails: bool) -> None:
    ones, nowhere = np.ones(1), np.zeros((1, 3))
    fixes = PoseFixes(np.array([row]), ones, ones, nowhere, np.zeros((1, 4)), ones, ones, ones)
    lab.spoil("transport", "receive", change(fixes=fixes), FLYING)
    reason = lab.fly()["reason"]
    assert ("Telemetry.fixes.agent is" in reason) is fails


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            TaskOutput(goals(2, active=(True, True))),
            "has goals for agents that are not its own [contract-broken]",
        ),
        (
            TaskOutput(goals(3, active=(True,) * 3)),
            "every field of Goals has 3 rows, expected 2, one per agent [contract-broken]",
        ),
        (
            TaskOutput(goals(2, active=(True, False), speed=np.inf)),
            "Goals.speed is [inf], expected numbers [contract-broken]",
        ),
        (
            TaskOutput(
                commands=(Command(Order.STOP, np.array([0, 1]), NAN, NAN[:, 0], NAN[:, 0]),)
            ),
            "commands agents [0, 1], its own are (0,) [contract-broken]",
        ),
        (TaskOutput(commands=("land",)), "returned str, expected Command [contract-broken]"),  # type: ignore[arg-type]
        (TaskOutput(goals=NAN), "returned ndarray, expected Goals [contract-broken]"),  # type: ignore[arg-type]
    ],
)
def test_a_task_that_speaks_for_others_or_out_of_turn_is_named(
    lab: Lab, answer: TaskOutput, message: str
) -> None:
    lab.spoil("wait", "step", lambda *_: answer)
    summary = lab.fly("\n  - climb: {}\n  - wait: {agents: cf1, seconds: 1}")
    assert summary["reason"] == f"{NAMED['wait']}: {message}"
    assert brought_down(lab)


@pytest.mark.parametrize("around", ["parallel: [{STEP}]", "repeat: {times: 1, steps: [{STEP}]}"])
def test_every_task_is_made_before_anything_moves(lab: Lab, around: str) -> None:
    lab.spoil("wait", "make", BOOM)
    with pytest.raises(PluginError):
        lab.fly(f"\n  - climb: {{}}\n  - {around.replace('STEP', 'wait: {seconds: 1}')}")
    assert lab.ticks == []


def corrections(position: float, agent: int = 1) -> Corrections:
    deviation = np.array([0.1])
    attitude = np.array([[0.0, 0.0, 0.0, 1.0]])
    return Corrections(np.array([agent]), np.full((1, 3), position), attitude, deviation, deviation)


def test_localizer_corrections_reach_the_transport(lab: Lab) -> None:
    lab.spoil("localizer", "locate", change(corrections=corrections(0.5)), ONCE)
    assert lab.fly()["outcome"] == "completed"
    (reported,) = lab.robots.corrected
    assert (reported.agent.tolist(), reported.position.tolist()) == ([1], [[0.5, 0.5, 0.5]])


@pytest.mark.parametrize("wrong", [corrections(np.nan), corrections(0.5, agent=2)])
def test_invalid_corrections_are_attributed_to_the_localizer(lab: Lab, wrong: Corrections) -> None:
    lab.spoil("localizer", "locate", change(corrections=wrong), FLYING)
    assert lab.fly()["reason"].startswith(f"{NAMED['localizer']}: Estimate.corrections.")
    assert lab.robots.corrected == []


def test_mosaics_are_gray_when_localizers_and_observers_get_them(missions: Path) -> None:
    changes = ["cameras={color: {pixels: bayer_rggb}}", "swarm.cf2.camera=color", "localizer=flow"]
    flown = load(missions / "three_eyes.yaml", Registry(), changes)
    pipeline = PluginPipeline(flown, Registry())
    images: dict[int, Image] = {}
    try:
        pipeline.connect(())
        for tick in range(1, 12):
            pipeline.wait(tick * 0.05)
            frames = pipeline.receive().frames
            images |= dict(zip(frames.agent.tolist(), frames.image, strict=True))
    finally:
        pipeline.close()
    assert sorted(images) == [0, 1, 2]
    for image in images.values():
        red, green = image[::2, ::2].mean(), image[::2, 1::2].mean()
        assert red == pytest.approx(green, rel=0.02)
