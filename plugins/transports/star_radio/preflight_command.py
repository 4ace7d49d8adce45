"""The command ``star preflight``: whether the drones of a mission can fly it."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from star_core import Agent, Array, Image, InputError, Mission, PluginError, Registry, Scene, load
from star_core.commands import add_set_option
from star_core.toolkit import fill_defaults, gray_from_mosaic, yaw_from_quaternion
from star_radio import preflight
from star_radio.camera.expected_tags import tags_from
from star_radio.inspection import Inspector
from star_radio.mocap import TrueBodies
from star_radio.options import OPTIONS, RadioOptions
from star_radio.preflight import Finding, Placement, Severity
from star_radio.table import aligned

if TYPE_CHECKING:
    from star_radio.camera.ai_decks import AiDecks

LOW_VOLTAGE: Final = 3.2  # V, of missions without a rule: the firmware's `pm.lowVoltage`
MOCAP_TIMEOUT: Final = 2.0  # s, for the first frame
MAX_MARKER_DISTANCE: Final = 0.3  # m, from the start: localizer `mocap` takes none farther away
POLL_PERIOD: Final = 0.02  # s


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Check the drones of a mission; return the exit status: 1 if one cannot fly, else 0.

    Raises:
        InputError: The mission cannot be flown, or its transport is another.
    """
    mission = load(Path(options.mission), registry, options.set)
    choice = mission.plugins["transport"]
    if choice.use != "radio":
        text = (
            f"{options.mission}: its transport is {choice.use!r}, and only drones of 'radio' are "
            "checked; add --set transport=radio, and the `uri` of each agent"
        )
        raise InputError(text, "option-conflict")
    findings = [*agent_findings(mission, RadioOptions(**fill_defaults(choice.options, OPTIONS)))]
    write = _json if options.json else _text
    sys.stdout.write(write(mission, findings))
    return 1 if any(finding.severity is Severity.ERROR for finding in findings) else 0


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Check whether the drones of a mission can fly it, with a remedy for each fault. Nothing "
        "is reset, armed or flown."
    )
    line.epilog = "Exit status: 0 if all drones can fly, 1 on errors, 2 on bad input."
    line.add_argument("mission", help="mission file (YAML) with transport `radio`")
    add_set_option(line)
    line.add_argument("--json", action="store_true", help="as JSON")


def agent_findings(mission: Mission, options: RadioOptions) -> Iterator[Finding]:
    """Yield the findings of all agents, agent by agent."""
    scene = mission.scene
    limit = mission.safety.get("battery_low", {}).get("below", LOW_VOLTAGE)
    decks = _decks(scene, options)
    try:
        with Inspector({agent.name: agent.uri or "" for agent in scene.agents}) as inspector:
            inspections = inspector.inspect(settle=True)
        capture = _motion_capture(mission, options)
        placements, system = ({}, "") if capture is None else _placements(scene, capture)
        images = {} if decks is None else decks.survey(options.response_timeout)
    finally:
        if decks is not None:
            decks.close()
    for row, agent in enumerate(scene.agents):
        if agent.name not in inspections:
            remedy = "switch it on, and check its `uri`, the dongle and the distance"
            text = inspector.faults[agent.name]
            yield Finding(agent.name, "link", Severity.ERROR, text, remedy)
        else:
            yield from preflight.readiness(
                agent,
                inspections[agent.name],
                camera=agent.name in options.cameras,
                battery_low=limit,
                placement=placements.get(row),
                needs_map=scene.reports_in_map,
                flow_deck=scene.flow_deck,
            )
        if capture is not None:
            yield preflight.positioning(agent.name, visible=row in placements, why=system)
        if row in images:
            image, fault = images[row]
            low, high = (0, 0) if image is None else np.percentile(image, (1, 99))
            yield preflight.camera(
                agent.name,
                fault=fault,
                contrast=float(high - low),
                visible=0 if image is None else len(visible_tags(image, agent, scene)),
                expected=len(tags_from(agent, scene)),
            )


def visible_tags(image: Image, agent: Agent, scene: Scene) -> set[int]:
    """Return the numbers of the map's tags in an image of an agent, by OpenCV's detector."""
    import cv2

    if agent.camera is not None:
        image = gray_from_mosaic(image, agent.camera.pixels)
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    numbers: Any = cv2.aruco.ArucoDetector(family).detectMarkers(image)[1]  # None without any
    mapped = {tag.id for tag in scene.world.landmarks}
    return set() if numbers is None else mapped & {int(number) for number in numbers.flat}


def _decks(scene: Scene, options: RadioOptions) -> AiDecks | None:
    if not options.cameras:
        return None
    from star_radio.camera.ai_decks import AiDecks

    return AiDecks(scene, options.cameras, options.camera_latency)


def _motion_capture(mission: Mission, options: RadioOptions) -> Mapping[str, Any] | None:
    """Return the options of the system by which a mission flies, or that is its ground truth."""
    localizer = mission.plugins["localizer"]
    if localizer.use == "mocap" and localizer.options.get("source"):
        return localizer.options
    return options.mocap


def _placements(scene: Scene, system: Mapping[str, Any]) -> tuple[dict[int, Placement], str]:
    """Return where motion capture sees agents, by row, and why it does not work; else empty."""
    try:
        capture = TrueBodies(scene, system)
    except PluginError as error:
        return {}, error.message
    began = time.monotonic()
    try:
        while (truth := capture.truth(began)) is None or truth.time < 0:
            if time.monotonic() > began + MOCAP_TIMEOUT:
                return {}, f"motion capture sends no frame in {MOCAP_TIMEOUT:g} s"
            time.sleep(POLL_PERIOD)
        if system.get("track") == "markers":
            return _by_markers(scene, capture.markers()), ""
    finally:
        capture.close()
    return {
        row: Placement(
            "motion capture",
            tuple(truth.position[row].tolist()),
            float(yaw_from_quaternion(truth.attitude[row])),
        )
        for row in np.flatnonzero(np.isfinite(truth.position).all(axis=1)).tolist()
    }, ""


def _by_markers(scene: Scene, markers: Array) -> dict[int, Placement]:
    """Return where agents stand by the nearest of (M, 3) markers without names, by row."""
    placements = {}
    for row, agent in enumerate(scene.agents):
        distance = np.linalg.norm(markers - np.array(agent.start), axis=1)
        if distance.min(initial=np.inf) <= MAX_MARKER_DISTANCE:
            nearest = tuple(markers[int(distance.argmin())].tolist())
            placements[row] = Placement("motion capture", nearest, math.nan)
    return placements


def _text(mission: Mission, findings: Sequence[Finding]) -> str:
    rows = [("agent", "check", "", "found", "what to do")]
    rows += [
        (each.agent, each.check, str(each.severity), each.text, each.remedy) for each in findings
    ]
    count = sum(each.severity is Severity.ERROR for each in findings)
    warnings = sum(each.severity is Severity.WARNING for each in findings)
    faults = f"{count} error{'s' * (count != 1)} and {warnings} warning{'s' * (warnings != 1)}"
    end = f"{mission.name!r} can be flown" if not count else f"{mission.name!r} cannot be flown"
    return "\n".join([*aligned(rows), f"{end}: {faults}"]) + "\n"


def _json(mission: Mission, findings: Sequence[Finding]) -> str:
    ready = all(finding.severity is not Severity.ERROR for finding in findings)
    record = {"mission": mission.name, "ready": ready, "findings": [*map(asdict, findings)]}
    return json.dumps(record, indent=2) + "\n"
