"""What Crazyswarm2's robots have that the simulator does not need: parameters, decks, headings."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from star_core import InputError, Mission, Registry, fly, load
from tests.plugins.formats.star_import.conftest import Import

Put = Callable[[str, str], str]
Swarm = Callable[..., list[str]]
IMPORTED = Path("imported/crazyflies.yaml")
WARNING = (
    "crazyflies: warning: this swarm was localized by {}; it is flown by `{}`, which "
    "needs a Flow deck on each drone; see localizer `mocap` for the alternative"
)
TAGS = """\
april_tags:
  pair_position: [-0.122, -0.1095, -0.122, -0.3105]
  pair_paper_size: [0.297, 0.420]
  tags:
    id000: {location: [0.5, 0.5], purpose: relocalization}
"""


@pytest.fixture
def swarm(place: Put, take: Import) -> Swarm:
    """Import robots with some more keys each, types and what is for all; return the messages."""

    def imported(*robots: str, types: str = "{}", every: str = "{}", files: str = "") -> list[str]:
        lines = (
            f"  cf{i}: {{uri: radio://0/80/2M/E7E7E7E70{i}, initial_position: [0, {i}, 0], {more}}}"
            for i, more in enumerate(robots, start=1)
        )
        text = "\n".join(["robots:", *lines, f"robot_types: {types}", f"all: {every}"])
        place("crazyflies.yaml", text)
        return take("crazyflies.yaml", *files.split(), "--force", "--name", "crazyflies")

    return imported


def on_hardware() -> Mission:
    """Put what is commented out in the place of the simulator, and check the mission."""
    text = IMPORTED.read_text("utf-8")
    text, sims = re.subn(r"^transport: .*\n# on hardware.*\n", "", text, flags=re.MULTILINE)
    assert sims == 1
    text = re.sub(r"^# (transport:|  )", r"\1", text, flags=re.MULTILINE)
    radio = IMPORTED.with_name("radio.yaml")
    radio.write_text(text, encoding="utf-8")
    return load(radio, Registry())


def radio_options() -> dict[str, Any]:
    choice = on_hardware().plugins["transport"]
    assert choice.use == "radio"
    return dict(choice.written)


def test_robot_parameters_override_type_and_global_parameters(swarm: Swarm) -> None:
    told = swarm(
        "type: a, firmware_params: {ring: {effect: 7}, kalman: {mNBaro: 1.0e-7}}",
        "type: b, firmware_params: {ring: {effect: 7}, kalman: {mNBaro: 0.0000001}}",
        types="{a: {firmware_params: {stabilizer: {controller: 1}, ring: {effect: 3}}}, b: {}}",
        every="{firmware_params: {stabilizer: {estimator: 2, controller: 1}, ring: {effect: 0}}}",
    )
    assert load(IMPORTED, Registry()).plugins["transport"].use == "sim"
    assert radio_options() == {
        "parameters": {
            "stabilizer.estimator": 2,
            "stabilizer.controller": 1,
            "ring.effect": 7,
            "kalman.mNBaro": 1e-7,
        }
    }
    assert not [line for line in told if "warning" in line or "ignored" in line]


def test_parameters_differing_between_robots_are_left_out(swarm: Swarm) -> None:
    told = swarm(
        "a: 1",
        "firmware_params: {ring: {effect: 9}, pm: {lowVoltage: 3.2}}",
        "a: 1",
        every="{firmware_params: {ring: {effect: 7}, stabilizer: {estimator: 2}}}",
    )
    assert radio_options() == {"parameters": {"stabilizer.estimator": 2}}
    same = "but the radio transport sets the same in all; ignored"
    differ = [line.partition(": ")[2] for line in told if same in line]
    assert differ == [
        f"parameter ring.effect differs between robots (7 for cf1, cf3; 9 for cf2), {same}",
        f"parameter pm.lowVoltage differs between robots (not set for cf1, cf3; 3.2 for cf2), "
        f"{same}",
    ]


def test_mellingers_controller_is_steered_with_whole_states(swarm: Swarm) -> None:
    told = swarm("a: 1", every="{firmware_params: {stabilizer: {controller: 2}}}")
    assert radio_options() == {
        "setpoints": "full-state",
        "parameters": {"stabilizer.controller": 2},
    }
    assert [line for line in told if "Mellinger's, which tracks positions" in line]


@pytest.mark.parametrize(
    ("every", "message"),
    [
        ("{firmware_params: {ring: {effect: on}}}", "is 'on', expected a number"),
        ("{firmware_params: {ring: 7}}", "is 7, expected a map"),
        ("{firmware_params: {ring: {'a b': 7}}}", "'ring.a b' is not a parameter name"),
    ],
)
def test_parameters_that_are_none_are_refused(swarm: Swarm, every: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        swarm("a: 1", every=every)


def test_deck_addresses_become_cameras_of_the_radio_transport(swarm: Swarm) -> None:
    told = swarm(
        "ip_add: 192.168.1.101, port: 5000", "ip_add: deck-two, port: 5001", "ip_add: deck-two"
    )
    assert radio_options() == {
        "cameras": {"cf1": "192.168.1.101", "cf2": "deck-two:5001", "cf3": "deck-two"}
    }
    assert all(agent.camera for agent in on_hardware().scene.agents)
    assert (
        "crazyflies: commented out, for the radio transport: AI-deck of cf1 at 192.168.1.101, "
        "AI-deck of cf2 at deck-two:5001, AI-deck of cf3 at deck-two"
    ) in told
    summary = fly(load(IMPORTED, Registry()), Registry())
    assert summary["outcome"] == "completed"


def test_landmarks_enable_rendering_and_report_missing_decks(swarm: Swarm, place: Put) -> None:
    place("lab.yaml", TAGS)
    told = swarm("ip_add: 192.168.1.101", "a: 1", files="lab.yaml")
    assert load(IMPORTED, Registry()).plugins["transport"].written == {}
    assert radio_options() == {"cameras": {"cf1": "192.168.1.101"}}
    assert "crazyflies: no ip_add for cf2: add the AI-decks' addresses to cameras" in told


def test_a_deck_serves_one_agent(swarm: Swarm) -> None:
    told = swarm("ip_add: 192.168.4.1", "ip_add: 192.168.4.1")
    assert radio_options() == {"cameras": {"cf1": "192.168.4.1"}}
    assert [
        line for line in told if "cf2: the AI-deck at 192.168.4.1 belongs to another agent" in line
    ]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("ip_add: 'a b'", "cf1 has 'a b', expected a host"),
        ("ip_add: a, port: 0", "cf1 has 0, expected a port"),
        ("ip_add: a, port: 5000.5", "cf1 has 5000.5, expected a port"),
    ],
)
def test_addresses_that_are_none_are_refused(swarm: Swarm, more: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        swarm(more)


@pytest.mark.parametrize("degrees", [0, 90, -135, 180])
def test_a_turned_start_has_a_heading(swarm: Swarm, degrees: float) -> None:
    half = math.radians(degrees) / 2
    told = swarm(f"initial_quaternion: [0, 0, {2 * math.sin(half)}, {2 * math.cos(half)}]")
    (agent,) = load(IMPORTED, Registry()).scene.agents
    assert math.cos(agent.yaw - 2 * half) == pytest.approx(1.0)
    assert [line for line in told if f"yaw {degrees} degrees" in line]
    assert not [line for line in told if "tilted" in line]


def test_a_tilted_start_is_reported_and_keeps_its_heading(swarm: Swarm) -> None:
    half = math.radians(30) / 2
    told = swarm(f"initial_quaternion: [{math.sin(half)}, 0, 0, {math.cos(half)}]")
    assert [line for line in told if "cf1: initial_quaternion is tilted by 30 degrees" in line]
    (agent,) = load(IMPORTED, Registry()).scene.agents
    assert agent.yaw == pytest.approx(0.0)


@pytest.mark.parametrize("numbers", ["[0, 0, 1]", "[0, 0, 0, 0]"])
def test_a_heading_that_is_none_is_refused(swarm: Swarm, numbers: str) -> None:
    with pytest.raises(InputError, match="expected a quaternion x, y, z, w"):
        swarm(f"initial_quaternion: {numbers}")


@pytest.mark.parametrize(
    ("types", "every", "system"),
    [
        ("{a: {motion_capture: {enabled: true, marker: m}}}", "{}", "motion capture"),
        ("{a: {motion_capture: {tracking: vendor, marker: m}}}", "{}", "motion capture"),
        ("{a: {motion_capture: {marker: m}}}", "{}", "motion capture"),
        ("{a: {}}", "{firmware_params: {lighthouse: {method: 0}}}", "Lighthouse"),
        ("{a: {}}", "{firmware_params: {loco: {mode: 2}}}", "the Loco positioning system"),
    ],
)
def test_a_swarm_that_another_system_located_is_warned_of_first(
    swarm: Swarm, place: Put, types: str, every: str, system: str
) -> None:
    told = swarm("type: a", types=types, every=every)
    assert told[0] == WARNING.format(system, "flow")
    assert not [line for line in told[1:] if "motion" in line]
    assert "localizer: flow  # needs a Flow deck on each drone" in IMPORTED.read_text("utf-8")
    place("lab.yaml", TAGS)
    told = swarm("type: a", types=types, every=every, files="lab.yaml")
    assert told[0] == WARNING.format(system, "apriltag")


@pytest.mark.parametrize(
    "types",
    [
        "{a: {motion_capture: {enabled: false, marker: m}}}",
        "{a: {motion_capture: {tracking: none, marker: m}}}",
        "{a: {}, b: {motion_capture: {enabled: true}}}",
    ],
)
def test_a_swarm_that_located_itself_is_not_warned_of(swarm: Swarm, types: str) -> None:
    assert "warning" not in "\n".join(swarm("type: a", types=types))
