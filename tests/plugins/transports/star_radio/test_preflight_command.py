"""``star preflight``: what it finds, against a fleet in real time, and what a flight refuses."""

from __future__ import annotations

import dataclasses
import logging
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from star_core import Agent, Camera, Fence, InputError, PluginError, Scene, Supervisor, Tag, World
from star_core.testing import scene
from star_fleet.conditions import Condition
from star_radio import preflight
from star_radio.camera.expected_tags import tags_from
from star_radio.connection.link import Link
from star_radio.inspection import Equipment, Inspection, link_quality
from star_radio.preflight import Finding, Placement, Severity
from star_radio.preflight_command import _by_markers, visible_tags
from tests.campaign.preflight import CLEAN, FAULTS, misreports
from tests.commands import command
from tests.plugins.transports.star_radio.conftest import Open, Peers
from tests.simulators import ideal_fleet
from tests.waiting import PATIENCE

run = command("preflight")

FIT = Inspection(
    uri="udp://127.0.0.1:19850",
    firmware="2026.04",
    protocol=12,
    equipment=Equipment(("Flow2", "ZRanger2"), self_test=True),
    battery=4.1,
    state=int(Supervisor.CAN_FLY),
    position=(0.0, 0.0, 0.0),
    tilt=0.0,
    yaw=0.0,
    position_std=0.1,
    quality=100.0,
    signal=-41.0,
    stations={},
    unsettled="",
)
AGENT = Agent("cf1", (1.0, 0.0, 0.0), math.pi)
FENCE = Fence((-3.0, -3.0, 0.0), (3.0, 3.0, 2.0))
LIGHTHOUSE = Equipment(("Flow2", "Lighthouse4"), self_test=True)


def findings(
    placement: Placement | None = None,
    *,
    needs_map: bool = False,
    flow_deck: bool = True,
    **differs: Any,
) -> dict[str, Finding]:
    """What is found of a drone that differs from a fit one, by check."""
    checks = preflight.readiness(
        AGENT,
        dataclasses.replace(FIT, **differs),
        camera=False,
        battery_low=3.2,
        placement=placement,
        needs_map=needs_map,
        flow_deck=flow_deck,
    )
    return {finding.check: finding for finding in checks}


@pytest.mark.parametrize(
    ("deck", "x", "severity"),
    [
        ("Lighthouse4", 1.14, Severity.OK),
        ("Lighthouse4", 1.3, Severity.ERROR),
        ("Loco", 1.3, Severity.OK),
        ("Loco", 1.5, Severity.ERROR),
    ],
)
def test_starts_are_compared_as_the_deck_can(deck: str, x: float, severity: Severity) -> None:
    checks = findings(position=(x, 0.0, 0.0), yaw=math.pi, stations={deck: 3})
    assert checks["start"].severity == severity


@pytest.mark.parametrize(("needs_map", "severity"), [(False, "warning"), (True, "error")])
def test_missing_stations_are_errors_if_they_locate(*, needs_map: bool, severity: str) -> None:
    checks = findings(needs_map=needs_map, equipment=LIGHTHOUSE, stations={"Lighthouse4": 0})
    assert checks["positioning"].severity == severity


@pytest.mark.parametrize("needs_map", [False, True])
@pytest.mark.parametrize("attached", [False, True])
@pytest.mark.parametrize("expected", [False, True])
def test_flow_decks_unlike_in_the_mission_are_named(
    *, needs_map: bool, attached: bool, expected: bool
) -> None:
    equipment = Equipment(("Lighthouse4", *["Flow2"] * attached), self_test=True)
    decks = findings(needs_map=needs_map, flow_deck=expected, equipment=equipment)["decks"]
    differs = needs_map and attached != expected
    assert decks.severity == (Severity.WARNING if differs else Severity.OK)
    assert (f"flow_deck: {str(attached).lower()}" in decks.remedy) == differs


@pytest.mark.extended
def test_each_injected_fault_is_named_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert misreports(FAULTS, tmp_path, 1) == {}


def test_drones_without_a_fault_raise_no_alarm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert misreports(CLEAN, tmp_path, 2) == {}


@pytest.mark.parametrize(
    ("differs", "check", "severity"),
    [
        ({"tilt": math.radians(14)}, "level", Severity.WARNING),
        ({"battery": math.nan}, "battery", Severity.ERROR),
        ({"battery": 3.19}, "battery", Severity.ERROR),
        ({"quality": 69.0}, "link", Severity.WARNING),
        ({"equipment": LIGHTHOUSE, "stations": {"Lighthouse4": 3}}, "start", Severity.ERROR),
        ({"equipment": LIGHTHOUSE, "stations": {"Lighthouse4": 0}}, "positioning", "warning"),
        (
            {"equipment": Equipment(("Lighthouse4",)), "stations": {"Lighthouse4": 0}},
            "positioning",
            Severity.ERROR,
        ),
        ({"equipment": Equipment(("LedRing",), self_test=True)}, "decks", Severity.WARNING),
    ],
)
def test_a_fault_has_a_severity_and_a_remedy(
    differs: dict[str, Any], check: str, severity: str
) -> None:
    faults = {name: each for name, each in findings(**differs).items() if each.severity != "ok"}
    assert [(name, each.severity) for name, each in faults.items()] == [(check, severity)]
    assert faults[check].remedy


def test_old_firmware_that_reports_little_is_no_fault() -> None:
    assert {each.severity for each in findings(equipment=Equipment()).values()} == {Severity.OK}


@pytest.mark.parametrize(
    ("x", "yaw_deg", "severity"),
    [(1.1, -175, "ok"), (1.2, 180, "error"), (1.0, 169, "error"), (1.0, 171, "ok")],
)
def test_starts_are_compared_with_the_mission(x: float, yaw_deg: float, severity: str) -> None:
    placement = Placement("motion capture", (x, 0.0, 0.0), math.radians(yaw_deg))
    assert findings(placement)["start"].severity == severity


def test_a_marker_measures_the_start_without_a_heading() -> None:
    room = dataclasses.replace(scene(2), agents=(AGENT, dataclasses.replace(AGENT, name="cf2")))
    x, y, z = AGENT.start
    near = _by_markers(room, np.array([[x + 5, y, z], [x + 0.1, y, z]]))
    assert near.keys() == {0, 1}
    start = findings(near[0])["start"]
    assert start.severity == Severity.OK
    assert start.text.startswith("0.10 m from [")
    assert findings(near[0]._replace(position=(x + 0.2, y, z)))["start"].severity == "error"
    assert _by_markers(room, np.array([[x + 0.4, y, z]])) == {}
    assert _by_markers(room, np.zeros((0, 3))) == {}


def test_cameras_that_see_no_tag_in_view_are_reported() -> None:
    blind = preflight.camera("cf1", fault="", contrast=99.0, visible=0, expected=2)
    assert blind.severity == Severity.WARNING
    assert "sees 0 tags of the map, 2 expected" in blind.text
    floor = preflight.camera("cf1", fault="", contrast=99.0, visible=0, expected=0)
    assert floor.severity == Severity.OK


@pytest.mark.parametrize(
    ("condition", "text"),
    [
        (Condition.LOCKED, "supervisor: locked (bits: auto_arm, locked): switch it off and on"),
        (Condition.FAILED_SELF_TEST, "self-test: failed: switch it off and on"),
    ],
)
def test_flights_refuse_drones_that_are_not_fit(
    condition: Condition, text: str, make: Open, caplog: pytest.LogCaptureFixture
) -> None:
    conditions = {1: frozenset({condition})}
    with ideal_fleet(scene(2), noise=False, conditions=conditions) as fleet:
        with pytest.raises(PluginError) as raised:
            make(fleet.addresses, response_timeout=PATIENCE).connect()
        assert raised.value.code == "agents-unfit"
        assert f"cannot fly 1 of 2 agents: cf2 ({text}" in raised.value.message
        radio = make(fleet.addresses, absent="fly-without", response_timeout=PATIENCE)
        with caplog.at_level(logging.WARNING):
            radio.connect()
        assert radio.connected.tolist() == [True, False]
        assert "flying without them" in caplog.text


def test_flights_warn_of_drones_without_a_position_deck(
    connect: Open, peers: Peers, caplog: pytest.LogCaptureFixture
) -> None:
    (peer,) = peers()
    peer.parameters["deck.bcFlow2"] = (0x48, b"\0")
    peer.stored["deck.bcFlow2"] = b"\0"
    connect([peer])
    assert "cf1: decks: none that measures its position (decks: none): attach" in caplog.text


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["missions/first_flight.yaml"], "option-conflict"),
        (["missions/missing.yaml"], "file-not-found"),
        (["missions/first_flight.yaml", "--set=transport=radio"], "missing-option"),
    ],
)
def test_missions_without_real_drones_are_refused(arguments: list[str], code: str) -> None:
    with pytest.raises(InputError) as raised:
        run(arguments)
    assert raised.value.code == code


def room_with_tag(distance: float) -> Scene:
    """A room with tag 3, of 0.2 m, on a wall that faces the start of an agent."""
    facing = (0.5, 0.5, 0.5, 0.5)  # its z axis along the map's x axis, its y axis up
    tag = Tag(3, 0.2, (1.0 - distance, 0.0, 0.015), facing, "wall")
    return dataclasses.replace(scene(1), world=World("room", FENCE, landmarks=(tag,)))


def test_tags_of_the_map_are_counted_in_images() -> None:
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    image = np.full((244, 324), 255, np.uint8)
    for number, left in ((3, 20), (586, 180)):
        image[60:160, left : left + 100] = cv2.aruco.generateImageMarker(family, number, 100)
    room = room_with_tag(1.0)
    assert visible_tags(image, AGENT, room) == {3}
    assert visible_tags(np.full_like(image, 128), AGENT, room) == set()


@pytest.mark.parametrize(
    ("distance", "pitch_deg", "expected"), [(1.0, 0, {3}), (1.0, 45, set()), (2.5, 0, set())]
)
def test_tags_are_expected_that_are_in_view_and_large(
    distance: float, pitch_deg: float, expected: set[int]
) -> None:
    camera = Camera(pitch=math.radians(pitch_deg))
    agent = dataclasses.replace(AGENT, camera=camera)
    assert tags_from(agent, room_with_tag(distance)) == expected
    behind = dataclasses.replace(agent, yaw=0.0)
    assert tags_from(behind, room_with_tag(distance)) == set()


def test_a_dongle_measures_the_quality_of_its_link() -> None:
    link = Link("radio://0/80/2M/E7E7E7E701", "cf1")
    link.note_quality({"link_quality": 64.0})
    assert link_quality(link) == 64.0
