"""Faults as a user writes them, and what a flight makes of them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import AgentPhase, Event, Registry, Tick, fly, hookimpl, load
from star_core.commands.main import main
from star_faults.fault_file import faults_of
from star_faults.injector import FaultInjector

pytestmark = pytest.mark.ideal_world

ROOM = {
    "star": 1,
    "name": "room",
    "fence": {"low": [-4, -4, 0], "high": [4, 4, 3]},
    "landmarks": {
        name: {"tags": [2 * i, 2 * i + 1], "at": [i - 1.5, 0.6, 0]} for i, name in enumerate("abcd")
    },
}
MISSION = {
    "star": 1,
    "name": "hover",
    "world": "room.yaml",
    "seed": 3,
    "swarm": {f"cf{i}": {"start": [i - 2.5, 0, 0]} for i in (1, 2, 3, 4)},
    "transport": "sim",
    "localizer": "flow",
    "planner": "straight",
    "avoider": "orca",
    "safety": {
        "link_lost": {"after": 0.5},
        "position_lost": {"after": 1.0},
        "battery_low": {},
        "tumbled": {},
    },
    "mission": [{"takeoff": {"height": 0.6}}, {"hold": {"for": 3}}, {"land": {"speed": 0.5}}],
    "rate": 10,
}


@dataclass
class Flown:
    """A flight with faults.

    Attributes:
        summary: Of the flight.
        events: Of the flight.
        ticks: Of the flight.
    """

    summary: Mapping[str, Any] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    ticks: list[Tick] = field(default_factory=list)

    @hookimpl
    def star_event(self, event: Event) -> None:
        self.events.append(event)

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self.ticks.append(tick)

    def texts(self, kind: str) -> list[str]:
        return [event.text for event in self.events if event.kind == kind]


def flown(folder: Path, *faults: Mapping[str, Any], **changes: Any) -> Flown:
    """Fly the mission, with changes, under faults."""
    (folder / "room.yaml").write_text(json.dumps(ROOM))
    (folder / "mission.yaml").write_text(json.dumps(MISSION | changes))
    flight = Flown()
    registry = Registry(flight)
    mission = load(folder / "mission.yaml", registry)
    (folder / "faults.yaml").write_text(json.dumps({"star": 1, "faults": faults}))
    if faults:
        injector = FaultInjector(mission.scene, faults_of(list(faults), mission.scene))
        registry.add(injector, type(registry.source("star-swarm:sim"))("test:faults"))
    flight.summary = fly(mission, registry)
    return flight


@pytest.mark.parametrize(
    ("fault", "rule"),
    [
        ({"component": "motor", "mode": "off"}, "tumbled"),
        ({"component": "telemetry", "mode": "off"}, "link_lost"),
        ({"component": "link", "mode": "off"}, "link_lost"),
        ({"component": "telemetry", "mode": "garbage"}, "position_lost"),
        ({"component": "battery", "mode": "wrong"}, "battery_low"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_faults_provoke_each_safety_rule(
    tmp_path: Path, fault: Mapping[str, Any], rule: str
) -> None:
    flight = flown(tmp_path, {**fault, "agents": "cf2", "at": 3.5})
    (safety,) = flight.texts("safety")
    assert safety.startswith("cf2 ")
    assert f": {rule}: " in safety
    (begun,) = (event for event in flight.events if event.kind == "fault")
    assert begun.text == f"fault: {fault['component']} of cf2: {fault['mode']}"
    assert begun.agent == "cf2"
    assert begun.time == pytest.approx(3.5, abs=0.06)
    assert flight.summary["outcome"] == "completed"


@pytest.mark.parametrize("at", [1.0, 2.8], ids=["in the take-off", "in the hold"])
def test_agents_that_missed_the_landing_land_when_heard_again(at: float, tmp_path: Path) -> None:
    """In flight its firmware stops the motors 2 s after the last setpoint."""
    off = {"component": "link", "mode": "off", "agents": "cf2", "at": at, "for": 1.0}
    flight = flown(tmp_path, off)
    again = "cf2 hovers instead of landing; it is commanded to land again"
    assert flight.texts("landing") == [again]
    assert flight.ticks[-1].health.phase[1] == AgentPhase.LANDED
    impact = min(tick.truth.velocity[1, 2] for tick in flight.ticks if tick.truth is not None)
    assert impact > -1.0


@pytest.mark.parametrize("back", [math.inf, 9.0])
def test_an_agent_without_a_link_in_its_take_off_comes_down(tmp_path: Path, back: float) -> None:
    """By itself: its motors stop when its link is back."""
    off: dict[str, Any] = {"component": "link", "mode": "off", "agents": "cf2", "at": 1.0}
    if back < math.inf:
        off["for"] = back
    mission = [{"takeoff": {"height": 0.6}}, {"hold": {"for": 10}}, {"land": {}}]
    flight = flown(tmp_path, off, mission=mission)
    heights = [tick.truth.position[1, 2] for tick in flight.ticks if tick.truth is not None]
    assert max(heights) > 0.5
    assert heights[-1] < 0.01
    phase = AgentPhase.LANDED if back < math.inf else AgentPhase.LANDING
    assert flight.ticks[-1].health.phase[1] == phase
    again = "cf2 stands with its motors on instead of landing; it is commanded to land again"
    assert flight.texts("landing").count(again) == (back < math.inf)
    impact = min(tick.truth.velocity[1, 2] for tick in flight.ticks if tick.truth is not None)
    assert impact > -0.45


@pytest.mark.parametrize(
    "fault",
    [
        {"component": "battery", "mode": "wrong"},
        {"component": "motor", "mode": "off"},
        {"component": "link", "mode": "off", "for": 4.0},
    ],
    ids=lambda fault: fault["component"],
)
def test_others_fly_low_over_an_agent_that_stays_on_the_ground(
    tmp_path: Path, fault: Mapping[str, Any]
) -> None:
    over = {"agents": "cf1", "to": [-0.5, 0, 0.5]}
    changes = {
        "limits": {"vertical_separation": 1.1},
        "mission": [{"takeoff": {}}, {"hold": {"for": 8}}, {"goto": over}, {"land": {}}],
    }
    flight = flown(tmp_path, {**fault, "agents": "cf2", "at": 4.0}, **changes)
    (safety,) = flight.texts("safety")
    assert safety.startswith("cf2 ")
    assert flight.summary["reason"] == ""


def test_random_reports_keep_the_last_located_position(tmp_path: Path) -> None:
    garbage = {"component": "telemetry", "mode": "garbage", "agents": "cf2", "at": 3.5}
    flight = flown(tmp_path, garbage)
    places = np.array([tick.estimate.position[1, :2] for tick in flight.ticks])
    assert np.abs(places - [-0.5, 0.0]).max() < 0.2
    located = [tick.estimate.valid[1] for tick in flight.ticks if tick.time > 3.6]
    assert not any(located)


@pytest.mark.parametrize("seed", [14, 24])
def test_a_drone_whose_reports_are_random_does_not_climb(tmp_path: Path, seed: int) -> None:
    garbage = {"component": "telemetry", "mode": "garbage", "agents": "cf2", "at": 3.5}
    flight = flown(tmp_path, garbage, seed=seed, transport="sim")
    heights = [tick.truth.position[1, 2] for tick in flight.ticks if tick.truth is not None]
    assert max(heights) < 0.8  # m, from a hover at 0.6 m


def test_a_planner_that_is_stuck_fails_as_one_that_raises(tmp_path: Path) -> None:
    goto = {"goto": {"agents": "cf4", "to": [2.0, 0, 0.6], "timeout": 60}}  # far from the fence
    stuck = {"component": "plugin", "plugin": "planner", "mode": "stuck", "at": 3.0}
    flight = flown(tmp_path, stuck, mission=[{"takeoff": {"height": 0.6}}, goto, {"land": {}}])
    assert flight.summary["reason"].endswith(
        "repeats a setpoint that leads cf4 past the goal [plugin-failed]"
    )
    assert any("brake: planner 'straight'" in text for text in flight.texts("plugin"))
    assert flight.summary["flight_time_s"] < 30.0


def test_a_flow_sensor_that_sees_no_motion_is_noticed(tmp_path: Path) -> None:
    steps = {"takeoff": {"height": 0.6}}, {"goto": {"agents": "cf4", "to": [1.5, 2.5, 0.6]}}
    stuck = {"component": "flow", "mode": "stuck", "agents": "cf4", "at": 3.0}
    flight = flown(tmp_path, stuck, mission=[*steps, {"land": {}}])
    (estimate,) = flight.texts("estimate")
    assert estimate.startswith("cf4 brakes: it flies faster than it reports")
    assert flight.texts("safety") == ["cf4 lands: position_lost: not located for 1 s"]
    before = next(tick for tick in reversed(flight.ticks) if tick.estimate.valid[3])
    assert before.truth is not None
    assert np.linalg.norm(before.estimate.position[3] - before.truth.position[3]) < 0.3
    truth = np.array([tick.truth.position[3] for tick in flight.ticks if tick.truth is not None])
    assert truth[:, 1].max() < 3.0
    assert truth[-1, 2] < 0.1


def test_a_short_silence_triggers_no_rule_and_is_reported_twice(tmp_path: Path) -> None:
    off = {"component": "link", "mode": "off", "agents": "cf1", "at": 4}
    flight = flown(tmp_path, {**off, "for": 0.3}, rate=20)
    assert flight.texts("fault") == ["fault: link of cf1: off", "fault: link of cf1: ok"]
    assert flight.texts("safety") == []
    repaired = flown(tmp_path, off, {**off, "mode": "ok", "at": 4.3})
    assert repaired.texts("fault") == flight.texts("fault")
    assert max(tick.telemetry.age[0] for tick in flight.ticks) == pytest.approx(0.25)


def test_faulty_flights_are_reproducible(tmp_path: Path) -> None:
    fault = {"component": "link", "mode": "intermittent", "loss": 0.5}
    first, second = flown(tmp_path, fault), flown(tmp_path, fault)
    for tick, again in zip(first.ticks, second.ticks, strict=True):
        assert (tick.telemetry.age == again.telemetry.age).all()
    ages = np.array([tick.telemetry.age for tick in first.ticks])
    assert 0.35 < (ages > 0).mean() < 0.65
    assert flown(tmp_path, {**fault, "probability": 0}).texts("fault") == []


@pytest.mark.extended
def test_reports_are_late_slow_stuck_or_wrong(tmp_path: Path) -> None:
    telemetry = {"component": "telemetry", "at": 3}
    flight = flown(
        tmp_path,
        {**telemetry, "mode": "delayed", "delay": 0.25, "agents": "cf1"},
        {**telemetry, "mode": "slow", "rate": 5, "agents": "cf2"},
        {**telemetry, "mode": "stuck", "agents": "cf3"},
        {**telemetry, "mode": "wrong", "offset": [0, 0.5, 0], "agents": "cf4"},
        safety={},
        rate=20,
    )
    plain = {round(tick.time, 3): tick for tick in flown(tmp_path, safety={}, rate=20).ticks}
    tick = next(tick for tick in flight.ticks if tick.time >= 4)
    age = tick.telemetry.age
    assert age[0] == pytest.approx(0.25)
    assert 0 <= age[1] <= 0.2
    assert (age[2:] == 0).all()
    late = plain[round(tick.time - 0.25, 3)].telemetry.position[0]
    np.testing.assert_allclose(tick.telemetry.position[0], late, atol=0.02)
    begun = next(tick for tick in flight.ticks if tick.time >= 3)
    assert (tick.telemetry.position[2] == begun.telemetry.position[2]).all()
    truth = tick.truth
    assert truth is not None
    assert tick.estimate.position[3, 1] - truth.position[3, 1] == pytest.approx(0.5, abs=0.2)


BROKEN = ("off", "garbage", "intermittent")


@pytest.mark.parametrize(
    ("kind", "mode"),
    [
        ("localizer", "off"),
        ("localizer", "stuck"),
        ("localizer", "wrong"),
        ("localizer", "delayed"),
        ("planner", "garbage"),
        ("planner", "wrong"),
        ("avoider", "intermittent"),
        ("avoider", "stuck"),
        ("task", "off"),
        ("task", "wrong"),
        ("transport", "off"),
    ],
)
def test_a_faulty_plugin_ends_with_all_agents_on_the_ground(
    tmp_path: Path, kind: str, mode: str
) -> None:
    at = {"at": 3.5} | ({"for": 0.4} if kind == "transport" else {})
    flight = flown(tmp_path, {"component": "plugin", "plugin": kind, "mode": mode, **at})
    assert flight.texts("fault")[0] == f"fault: plugin {kind}: {mode}"
    truth = flight.ticks[-1].truth
    assert truth is not None
    assert (truth.position[:, 2] < 0.1).all()
    assert (flight.summary["outcome"] == "failed") >= (mode in BROKEN)
    assert (f"{kind} '" in flight.summary["reason"]) >= (mode in BROKEN)


def test_sensor_faults_need_simulated_sensors(tmp_path: Path) -> None:
    at = {"at": 3}
    flight = flown(
        tmp_path,
        {"component": "ranger", "mode": "wrong", "bias": 0.3, "agents": "cf1", **at},
        {"component": "flow", "mode": "garbage", "agents": "cf2", **at},
        {"component": "gyro", "mode": "wrong", "bias": 0.5, "agents": "cf3", **at},
        {"component": "motor", "mode": "wrong", "motors": [1, 2, 3, 4], "agents": "cf4", **at},
        safety={},
    )
    tick = next(tick for tick in flight.ticks if tick.time >= 5)
    truth = tick.truth
    assert truth is not None
    error = tick.estimate.position - truth.position
    assert error[0, 2] == pytest.approx(0.3, abs=0.05)
    assert np.linalg.norm(error[1, :2]) > 2 * np.linalg.norm(error[3, :2])
    assert abs(tick.estimate.yaw[2]) < 0.2
    assert flight.summary["outcome"] == "completed"
    exact = {"use": "sim", "noise": False}
    with pytest.raises(Exception, match="no faults of flow with `noise: false`"):
        flown(tmp_path, {"component": "flow", "mode": "off"}, transport=exact)


def test_drones_without_flow_decks_have_no_faults_of_theirs(tmp_path: Path) -> None:
    ranging = {"use": "sim", "onboard": {"system": "poses", "flow_deck": False}}
    for component in ("flow", "ranger"):
        with pytest.raises(Exception, match=f"no faults of {component} without Flow decks"):
            flown(
                tmp_path,
                {"component": component, "mode": "off"},
                transport=ranging,
                localizer={"use": "onboard", "system": "poses"},
            )


def test_an_empty_battery_drops_the_drone(tmp_path: Path) -> None:
    empty = {"component": "battery", "mode": "wrong", "charge": 0.0, "agents": "cf1", "at": 4}
    flight = flown(tmp_path, empty)
    truth = next(tick.truth for tick in flight.ticks if tick.time >= 5)
    assert truth is not None
    assert truth.position[0, 2] < 0.1 < truth.position[1, 2]


SEEING = {
    "swarm": {
        f"cf{i}": {"start": [i - 2.5, 0, 0], "yaw_deg": 90, "camera": "aideck"}
        for i in (1, 2, 3, 4)
    },
    "transport": {"use": "sim", "camera": {"mode": "geometric"}},
    "localizer": "apriltag",
}


@pytest.mark.extended
def test_camera_faults_and_displaced_landmarks_are_simulated(tmp_path: Path) -> None:
    camera = {"component": "camera", "at": 3}
    flight = flown(
        tmp_path,
        {**camera, "mode": "off", "agents": "cf1"},
        {**camera, "mode": "slow", "rate": 2, "agents": "cf2"},
        {**camera, "mode": "delayed", "delay": 0.4, "agents": "cf3"},
        {"component": "tags", "mode": "wrong", "offset": [0, 0.3, 0], "tags": ["d"]},
        **SEEING,
    )
    after = [tick for tick in flight.ticks if 3.2 <= tick.time < 5.2]
    counts = np.zeros(4)
    for tick in after:
        detections = tick.telemetry.detections
        counts += np.bincount(detections.agent, minlength=4)
        late = detections.agent == 2
        assert (tick.time - detections.taken[late] >= 0.4).all()
    assert counts[0] == 0
    assert 0 < counts[1] < counts[2]
    truth = after[-1].truth
    assert truth is not None
    error = after[-1].estimate.position - truth.position
    assert error[3, 1] == pytest.approx(-0.3, abs=0.1)


def test_images_are_dark_cut_or_stuck(tmp_path: Path) -> None:
    camera = {"component": "camera", "at": 0.5}
    rendered = {"use": "sim", "camera": {"mode": "rendered"}}
    flight = flown(
        tmp_path,
        {**camera, "mode": "wrong", "factor": 0.1, "agents": "cf1"},
        {**camera, "mode": "garbage", "agents": "cf2"},
        {**camera, "mode": "stuck", "agents": "cf3"},
        **{**SEEING, "transport": rendered, "localizer": "flow"},
        mission=[{"takeoff": {"height": 0.4, "speed": 0.5}}, {"land": {"speed": 0.5}}],
    )
    images: dict[int, list[Any]] = {0: [], 1: [], 2: [], 3: []}
    for tick in flight.ticks:
        if tick.time > 0.5:
            for row, image in zip(
                tick.telemetry.frames.agent.tolist(), tick.telemetry.frames.image, strict=True
            ):
                images[row].append(image)
    assert max(image.max() for image in images[0]) <= 26
    assert all((image[-1] == 127).all() for image in images[1])
    assert all((image == images[2][0]).all() for image in images[2])
    assert any((image != images[3][0]).any() for image in images[3])


def test_the_command_injects_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flown(tmp_path, {"component": "telemetry", "mode": "off", "agents": "cf1", "at": 3})
    assert main(["check", str(tmp_path / "faults.yaml")]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'faults.yaml'}: 1 fault to inject\n"
    run = ["run", str(tmp_path / "mission.yaml"), "--no-record", "--json"]
    assert main([*run, "--faults", str(tmp_path / "faults.yaml")]) == 0
    assert json.loads(capsys.readouterr().out)["outcome"] == "completed"
    wrong = {"component": "telemetry", "mode": "off", "agents": "cf9"}
    (tmp_path / "faults.yaml").write_text(json.dumps({"star": 1, "faults": [wrong]}))
    assert main([*run, "--faults", str(tmp_path / "faults.yaml")]) == 2
    assert "no agent named 'cf9'" in capsys.readouterr().err
