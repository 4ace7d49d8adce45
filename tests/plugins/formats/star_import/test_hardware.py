"""What Crazyswarm2's robots have that the simulator does not need: parameters, decks, headings."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from star_core import Mission, Registry, fly, load
from tests.plugins.formats.star_import.conftest import ROBOTS, Import, place

Swarm = Callable[..., list[str]]
IMPORTED = Path("imported/crazyflies.yaml")
WARNING = (
    "changed crazyflies.yaml:2:8: the swarm was localized by {}; it is flown by `{}`, which "
    "needs a Flow deck on each drone; with the file of its base stations or anchors it is flown by "
    "`onboard`"
)
TAGS = """\
april_tags:
  pair_position: [-0.122, -0.1095, -0.122, -0.3105]
  pair_paper_size: [0.297, 0.420]
  tags:
    id000: {location: [0.5, 0.5], purpose: relocalization}
"""


@pytest.fixture
def swarm(take: Import) -> Swarm:
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
    text = re.sub(
        r"^localizer: .*\n# on hardware.*\n# localizer", "localizer", text, flags=re.MULTILINE
    )
    text = re.sub(r"^# (transport:|  )", r"\1", text, flags=re.MULTILINE)
    radio = IMPORTED.with_name("radio.yaml")
    radio.write_text(text, encoding="utf-8")
    return load(radio, Registry())


def radio_options() -> dict[str, Any]:
    choice = on_hardware().plugins["transport"]
    assert choice.use == "radio"
    return dict(choice.written)


def test_robot_parameters_override_type_and_global_parameters(swarm: Swarm) -> None:
    swarm(
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


def test_parameters_that_differ_are_set_per_agent(swarm: Swarm) -> None:
    swarm(
        "a: 1",
        "firmware_params: {ring: {effect: 9}, pm: {lowVoltage: 3.2}}",
        "a: 1",
        every="{firmware_params: {ring: {effect: 7}, stabilizer: {estimator: 2}}}",
    )
    assert radio_options() == {
        "parameters": {"stabilizer.estimator": 2},
        "agent_parameters": {
            "cf1": {"ring.effect": 7},
            "cf2": {"ring.effect": 9, "pm.lowVoltage": 3.2},
            "cf3": {"ring.effect": 7},
        },
    }


def test_mellingers_controller_flies_in_simulation_too(swarm: Swarm) -> None:
    swarm("a: 1", every="{firmware_params: {stabilizer: {controller: 2}}}")
    assert radio_options() == {
        "setpoints": "full-state",
        "parameters": {"stabilizer.controller": 2},
    }
    assert load(IMPORTED, Registry()).plugins["transport"].written == {"controller": "mellinger"}


@pytest.mark.parametrize(
    ("first", "every", "values"),
    [
        ("{stabilizer: {controller: 2}}", "{stabilizer: {controller: 1}}", "1, 2"),
        ("{}", "{stabilizer: {controller: 5}}", "5"),
    ],
)
def test_controllers_that_the_simulator_lacks_are_reported(
    swarm: Swarm, first: str, every: str, values: str
) -> None:
    notes = swarm(f"firmware_params: {first}", "a: 1", every=f"{{firmware_params: {every}}}")
    text = f"stabilizer.controller {values}: the simulator flies all agents by PID"
    assert f"changed crazyflies.yaml:2:8: {text}" in notes
    assert load(IMPORTED, Registry()).plugins["transport"].written == {}


def test_deck_addresses_become_cameras_of_the_radio_transport(swarm: Swarm) -> None:
    told = swarm(
        "ip_add: 192.168.1.101, port: 5000", "ip_add: deck-two, port: 5001", "ip_add: deck-two"
    )
    assert radio_options() == {
        "cameras": {"cf1": "192.168.1.101", "cf2": "deck-two:5001", "cf3": "deck-two"}
    }
    assert all(agent.camera for agent in on_hardware().scene.agents)
    comments = "what hardware needs is in comments: replace `transport: sim` by them"
    assert f"assumed crazyflies: {comments}" in told
    summary = fly(load(IMPORTED, Registry()), Registry())
    assert summary["outcome"] == "completed"


def test_landmarks_enable_rendering_and_report_missing_decks(swarm: Swarm) -> None:
    place("lab.yaml", TAGS)
    told = swarm("ip_add: 192.168.1.101", "a: 1", files="lab.yaml")
    assert load(IMPORTED, Registry()).plugins["transport"].written == {}
    assert radio_options() == {"cameras": {"cf1": "192.168.1.101"}}
    assert "assumed crazyflies: no ip_add for cf2: add the AI-decks' addresses to cameras" in told


def test_a_deck_serves_one_agent(swarm: Swarm) -> None:
    told = swarm("ip_add: 192.168.4.1", "ip_add: 192.168.4.1")
    assert radio_options() == {"cameras": {"cf1": "192.168.4.1"}}
    assert [line for line in told if "cf2: the AI-deck at 192.168.4.1 belongs to another" in line]


@pytest.mark.parametrize("degrees", [0, 90, -135, 180])
def test_a_turned_start_has_a_heading(swarm: Swarm, degrees: float) -> None:
    half = math.radians(degrees) / 2
    notes = swarm(f"initial_quaternion: [0, 0, {2 * math.sin(half)}, {2 * math.cos(half)}]")
    (agent,) = load(IMPORTED, Registry()).scene.agents
    assert math.cos(agent.yaw - 2 * half) == pytest.approx(1.0)
    assert not [note for note in notes if "tilted" in note]


def test_a_tilted_start_is_reported_and_keeps_its_heading(swarm: Swarm) -> None:
    half = math.radians(30) / 2
    told = swarm(f"initial_quaternion: [{math.sin(half)}, 0, 0, {math.cos(half)}]")
    tilted = "agents start level: only the yaw of a tilted initial_quaternion is used"
    assert [note for note in told if f"cf1: {tilted}" in note]
    (agent,) = load(IMPORTED, Registry()).scene.agents
    assert agent.yaw == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("every", "system"),
    [
        ("{firmware_params: {lighthouse: {method: 0}}}", "Lighthouse"),
        ("{firmware_params: {loco: {mode: 2}}}", "the Loco positioning system"),
    ],
)
def test_a_swarm_that_another_system_located_is_warned_of(
    swarm: Swarm, every: str, system: str
) -> None:
    assert WARNING.format(system, "flow") in swarm("a: 1", every=every)
    place("lab.yaml", TAGS)
    assert WARNING.format(system, "apriltag") in swarm("a: 1", every=every, files="lab.yaml")


ALL, SOME, NONE = "mocap", "flow", "flow"


@pytest.mark.parametrize(
    ("first", "types", "localizer"),
    [
        ("type: a", "{a: {motion_capture: {enabled: true, marker: m}}}", ALL),
        ("type: a", "{a: {motion_capture: {tracking: vendor, marker: m}}}", ALL),
        ("type: a", "{a: {motion_capture: {marker: m}}}", ALL),
        ("type: b", "{a: {motion_capture: {enabled: true}}, b: {}}", SOME),
        ("type: a, motion_capture: {enabled: false}",
         "{a: {motion_capture: {enabled: true, marker: m}}}", SOME),
        ("type: a", "{a: {motion_capture: {enabled: false, marker: m}}}", NONE),
        ("type: a", "{a: {motion_capture: {tracking: none, marker: m}}}", NONE),
        ("type: a", "{a: {}, b: {motion_capture: {enabled: true}}}", NONE),
    ],
)  # fmt: skip
def test_motion_capture_localizes_if_it_measures_all(
    swarm: Swarm, first: str, types: str, localizer: str
) -> None:
    notes = swarm(first, "type: a", types=types)
    mission = load(IMPORTED, Registry())
    assert mission.plugins["localizer"].use == localizer
    partial = [note for note in notes if note.startswith("changed") and "motion capture" in note]
    assert bool(partial) == (
        "enabled: true" in types and localizer == SOME and "b: {m" not in types
    )


CAPTURE = """\
/motion_capture_tracking:
  ros__parameters:
    type: "{type}"
    hostname: "10.1.2.3"
    marker_configurations:
      one: {{offset: [0.0, 0.0, -0.01], points: {{p0: [0.0, 0.0, 0.0]}}}}
      four: {{offset: [0.0, 0.0, 0.0], points: {{p0: [0, 0, 0], p1: [0, 0, 1]}}}}
"""


@pytest.mark.parametrize(
    ("system", "marker", "localizer"),
    [
        ("optitrack", "four", '{use: mocap, source: {natnet: {host: "10.1.2.3"}}}'),
        ("qualisys", "one", '{use: mocap, track: markers, source: {qtm: {host: "10.1.2.3"}}}'),
        ("vicon", "four",
         '{use: mocap, source: {motioncapture: {type: vicon, host: "10.1.2.3"}}}'),
    ],
)  # fmt: skip
def test_the_motion_capture_system_becomes_a_source(
    swarm: Swarm, system: str, marker: str, localizer: str
) -> None:
    place("motion_capture.yaml", CAPTURE.format(type=system))
    types = f"{{a: {{motion_capture: {{enabled: true, marker: {marker}}}}}}}"
    notes = swarm("type: a", types=types, files="motion_capture.yaml")
    assert f"# localizer: {localizer}" in IMPORTED.read_text("utf-8")
    assert any("the offset of the markers" in note for note in notes) == (marker == "one")
    assert fly(load(IMPORTED, Registry()), Registry())["outcome"] == "completed"


def test_robots_without_a_connection_are_no_agents(swarm: Swarm) -> None:
    types = "{a: {}, ball: {connection: none, motion_capture: {enabled: true}}}"
    notes = swarm("type: a", "type: ball", "type: a, connection: none", types=types)
    assert [agent.name for agent in load(IMPORTED, Registry()).scene.agents] == ["cf1"]
    text = "has no connection: it is a marker for motion capture, not an agent"
    assert [note for note in notes if note.endswith(text)] == [
        f"ignored crazyflies.yaml:{line}:8: cf{i}: {text}" for i, line in ((2, 3), (3, 4))
    ]


def test_crazyswarms_robots_have_their_types_parameters(take: Import) -> None:
    place(
        "allCrazyflies.yaml",
        "crazyflies:\n  - {id: 1, channel: 100, initialPosition: [1.5, 1, 0.0], type: default}\n"
        "  - {id: 10, channel: 110, initialPosition: [1.5, 2, 0.0], type: heavy}\n",
    )
    place(
        "crazyflieTypes.yaml",
        "crazyflieTypes:\n  default: {bigQuad: False, batteryVoltateCritical: 3.7, "
        "firmwareParams: {ctrlMel: {kp_xy: 0.4, mass: 0.032}}}\n"
        "  heavy: {firmwareParams: {ctrlMel: {kp_xy: 0.4, mass: 0.11}}}\n"
        "numMarkerConfigurations: 4\n",
    )
    take("allCrazyflies.yaml", "crazyflieTypes.yaml", "--name", "crazyflies")
    mission = load(IMPORTED, Registry())
    assert [(agent.name, agent.uri) for agent in mission.scene.agents] == [
        ("cf1", "radio://0/100/2M/E7E7E7E701"),
        ("cf10", "radio://0/110/2M/E7E7E7E70A"),
    ]
    assert mission.plugins["localizer"].use == "mocap"
    text = IMPORTED.read_text("utf-8")
    assert "#   parameters:\n#     ctrlMel.kp_xy: 0.4\n#   agent_parameters:\n" in text
    assert "#     cf1:\n#       ctrlMel.mass: 0.032\n" in text
    assert "#     cf10:\n#       ctrlMel.mass: 0.11\n" in text


def test_links_of_any_dongle_are_explained_and_left_out(take: Import) -> None:
    place("crazyflies.yaml", ROBOTS.replace("radio://0/80/2M/E7E7E7E702", "radio://*/80/2M/E7"))
    (note,) = [note for note in take("crazyflies.yaml") if "radio://*" in note]
    assert note.startswith("changed crazyflies.yaml:3:8: cf2: 'radio://*' takes any dongle")
    assert note.endswith("as in radio://0/80/2M/E7")
    assert [agent.uri for agent in load(IMPORTED, Registry()).scene.agents][1] is None
