"""Checks before a flight: what ``star preflight`` reports, and what ``star run`` refuses to fly."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

from star_core import Agent, Supervisor
from star_core.toolkit import shortlist, wrap_angle
from star_radio.connection.link import MIN_QUALITY
from star_radio.inspection import Equipment, Inspection

MAX_TILT: Final = math.radians(10.0)  # of a drone that stands level; chosen, not measured
MAX_START_ERROR: Final = 0.15  # m; chosen, not measured
MAX_RANGED_ERROR: Final = 0.4  # m, of a start by Loco alone, which errs by decimetres; chosen
MAX_YAW_ERROR: Final = math.radians(10.0)  # 9 cm after 0.5 m; chosen, not measured
MIN_CONTRAST: Final = 8.0  # gray levels; an uncovered lens has more, chosen, not measured
POSITION_DECKS: Final = ("Flow2", "Flow", "Lighthouse4", "Loco", "DWM1000")
FLOW_DECKS: Final = ("Flow2", "Flow")
CAMERA_DECK: Final = "AI"

SUPERVISOR: Final = {
    Supervisor.LOCKED: ("locked", "switch it off and on"),
    Supervisor.CRASHED: ("crashed", "look at it, then switch it off and on"),
    Supervisor.TUMBLED: ("tumbled", "put it upright"),
    Supervisor.DECK_FAULT: (
        "deck fault",
        "check that its decks are plugged in well, then switch it off and on",
    ),
}
"""Bits with which a drone cannot fly: what they mean, and the remedy."""


class Severity(StrEnum):
    """What a finding means for the flight."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check of one agent.

    Attributes:
        agent: Its name.
        check: Name of the check.
        severity: Whether it can fly.
        text: What was found.
        remedy: What to do; empty if nothing is wrong.
    """

    agent: str
    check: str
    severity: Severity
    text: str
    remedy: str = ""


class Placement(NamedTuple):
    """Where a drone stands in the map, by something that measures it.

    Attributes:
        source: What measures it.
        position: m.
        yaw: rad; NaN if it is not measured.
        tolerance: Distance from a start that is no error, m.
    """

    source: str
    position: tuple[float, float, float]
    yaw: float
    tolerance: float = MAX_START_ERROR


def fitness(
    agent: str,
    equipment: Equipment,
    state: int,
    *,
    camera: bool,
    settled: bool,
    flow_deck: bool | None = None,
) -> Iterator[Finding]:
    """Yield what a drone reports of its supervisor, self-test and decks.

    Args:
        agent: Its name.
        equipment: Its decks and self-test.
        state: Bits of its supervisor.
        camera: Whether the mission uses its camera.
        settled: Whether its estimator has converged, by whatever it measures.
        flow_deck: Whether the mission expects a Flow deck beside a positioning system; None if it
            has none of these.
    """
    bits = [each for bit, each in SUPERVISOR.items() if state & bit]
    names = ", ".join(str(bit.name).lower() for bit in Supervisor if state & bit) or "none"
    if bits:
        text = f"{', '.join(name for name, _ in bits)} (bits: {names})"
        yield Finding(
            agent, "supervisor", Severity.ERROR, text, "; ".join(what for _, what in bits)
        )
    else:
        yield Finding(agent, "supervisor", Severity.OK, f"bits: {names}")
    if equipment.self_test is False:
        remedy = "switch it off and on while it stands still; its console names what fails"
        yield Finding(agent, "self-test", Severity.ERROR, "failed", remedy)
    else:
        text = "not reported" if equipment.self_test is None else "passed"
        yield Finding(agent, "self-test", Severity.OK, text)
    yield from _decks(agent, equipment.decks, camera=camera, settled=settled, flow_deck=flow_deck)


def readiness(
    agent: Agent,
    drone: Inspection,
    *,
    camera: bool,
    battery_low: float,
    placement: Placement | None,
    needs_map: bool = False,
    flow_deck: bool = True,
) -> Iterator[Finding]:
    """Yield what was found of one drone, except of its camera.

    Args:
        agent: As the mission has it.
        drone: Its condition.
        camera: Whether the mission uses its camera.
        battery_low: V, below which it is not started.
        placement: Where a positioning system outside of it measures it, if there is one.
        needs_map: Whether the mission's localizer takes positions of estimators that know the map.
        flow_deck: Whether the mission expects a Flow deck.
    """
    name = agent.name
    if drone.quality < MIN_QUALITY:
        text = f"its quality is {drone.quality:.0f} %, expected {MIN_QUALITY:g} %"
        remedy = "move the dongle nearer, change the channel, or use fewer drones per dongle"
        yield Finding(name, "link", Severity.WARNING, text, remedy)
    else:
        yield Finding(name, "link", Severity.OK, f"its quality is {drone.quality:.0f} %")
    yield Finding(name, "firmware", Severity.OK, drone.firmware or f"protocol {drone.protocol}")
    settled = not drone.unsettled
    yield from fitness(
        name,
        drone.equipment,
        drone.state,
        camera=camera,
        settled=settled,
        flow_deck=flow_deck if needs_map else None,
    )
    volts = f"{drone.battery:.2f} V"
    if drone.battery >= battery_low:
        yield Finding(name, "battery", Severity.OK, volts)
    else:
        text = f"{volts}, below {battery_low:g} V" if math.isfinite(drone.battery) else "no voltage"
        yield Finding(name, "battery", Severity.ERROR, text, "charge it")
    if settled:
        yield Finding(name, "estimator", Severity.OK, "converged")
    else:
        text, _, remedy = drone.unsettled.partition(": ")
        yield Finding(name, "estimator", Severity.ERROR, text, remedy or "start again")
    degrees = f"{math.degrees(drone.tilt):.0f}°"
    if drone.tilt > MAX_TILT:
        text = f"stands tilted by {degrees}"
        remedy = "put it on a level floor, then switch it off and on"
        yield Finding(name, "level", Severity.WARNING, text, remedy)
    else:
        yield Finding(name, "level", Severity.OK, f"tilted by {degrees}")
    yield from _stations(name, drone, needs_map=needs_map)
    if placement is None and drone.knows_map:
        tolerance = MAX_START_ERROR if drone.stations.get("Lighthouse4") else MAX_RANGED_ERROR
        placement = Placement("its estimator", drone.position, drone.yaw, tolerance)
    yield _start(agent, placement)


def positioning(agent: str, *, visible: bool, why: str = "") -> Finding:
    """Return what motion capture sees of an agent.

    Args:
        agent: Its name.
        visible: Whether its body, or a marker near its start, is in a new frame.
        why: Why the system does not work; empty if it does.
    """
    if visible:
        return Finding(agent, "positioning", Severity.OK, "motion capture measures it")
    if why:
        remedy = "start the system, and check the options of its source"
        return Finding(agent, "positioning", Severity.ERROR, why, remedy)
    remedy = "check its markers, its start, and the name of its body in the system and in `bodies`"
    text = "motion capture does not measure it"
    return Finding(agent, "positioning", Severity.ERROR, text, remedy)


def camera(agent: str, *, fault: str, contrast: float, visible: int, expected: int) -> Finding:
    """Return what the camera of an agent sees.

    Args:
        agent: Its name.
        fault: Why no image of it arrives; empty if one does.
        contrast: Between its dark and bright pixels, gray levels.
        visible: Number of tags of the map in it.
        expected: The same, from the agent's start.
    """
    if fault:
        remedy = "close other viewers, check the deck's power and network, and `cameras`"
        return Finding(agent, "camera", Severity.WARNING, fault, remedy)
    if contrast < MIN_CONTRAST:
        text = f"its images show nothing: {contrast:.0f} of 255 gray levels"
        remedy = "take the cover off the lens, and switch on the light"
        return Finding(agent, "camera", Severity.WARNING, text, remedy)
    text = f"sees {visible} tags of the map, {expected} expected from its start"
    if expected and not visible:
        remedy = "check lens cap, light, mounting, and that the drone stands on its start"
        return Finding(agent, "camera", Severity.WARNING, text, remedy)
    return Finding(agent, "camera", Severity.OK, text)


def errors(findings: Iterable[Finding]) -> str:
    """Return the errors and their remedies as text; empty without one."""
    return "; ".join(
        f"{finding.check}: {finding.text}: {finding.remedy}"
        for finding in findings
        if finding.severity is Severity.ERROR
    )


def _decks(
    agent: str,
    decks: Sequence[str] | None,
    *,
    camera: bool,
    settled: bool,
    flow_deck: bool | None,
) -> Iterator[Finding]:
    if decks is None:
        yield Finding(agent, "decks", Severity.OK, "not reported")
        return
    lacking = []
    if not set(POSITION_DECKS) & set(decks):
        lacking.append("none that measures its position")
    if camera and CAMERA_DECK not in decks:
        lacking.append("no AI-deck")
    listed = shortlist(decks) or "none"
    if not lacking:
        attached = bool({*FLOW_DECKS} & {*decks})
        if flow_deck is None or attached == flow_deck:
            yield Finding(agent, "decks", Severity.OK, listed)
            return
        text = f"{'a' if attached else 'no'} Flow deck, unlike in the mission (decks: {listed})"
        remedy = f"write transport: {{use: radio, flow_deck: {str(attached).lower()}}}, or "
        remedy += "remove the deck" if attached else "attach one"
        yield Finding(agent, "decks", Severity.WARNING, text, remedy)
        return
    severity = Severity.WARNING if settled else Severity.ERROR
    remedy = "attach the deck, seat it firmly, then switch the drone off and on"
    yield Finding(agent, "decks", severity, f"{', '.join(lacking)} (decks: {listed})", remedy)


def _stations(agent: str, drone: Inspection, *, needs_map: bool) -> Iterator[Finding]:
    """Yield what the positioning systems on board receive."""
    for deck, bits in drone.stations.items():
        if bits:
            text = f"{deck}: uses {bits.bit_count()} stations"
            yield Finding(agent, "positioning", Severity.OK, text)
            continue
        others = set(POSITION_DECKS) & set(drone.equipment.decks or ()) - {*drone.stations}
        severity = Severity.WARNING if others and not needs_map else Severity.ERROR
        remedy = "switch the stations on, in sight, and write their geometry to the drone"
        yield Finding(agent, "positioning", severity, f"{deck}: uses no station", remedy)


def _start(agent: Agent, placement: Placement | None) -> Finding:
    x, y = agent.start[:2]
    planned = f"[{x:g}, {y:g}] heading {math.degrees(agent.yaw):.0f}°"
    if placement is None:
        text = f"nothing measures it: the mission expects {planned}"
        return Finding(agent.name, "start", Severity.OK, text)
    error = math.hypot(placement.position[0] - x, placement.position[1] - y)
    turn = abs(float(wrap_angle(placement.yaw - agent.yaw)))
    turned = "" if math.isnan(turn) else f" and {math.degrees(turn):.0f}°"
    if error <= placement.tolerance and not turn > MAX_YAW_ERROR:
        text = f"{error:.2f} m{turned} from {planned}, by {placement.source}"
        return Finding(agent.name, "start", Severity.OK, text)
    text = f"stands at [{placement.position[0]:.2f}, {placement.position[1]:.2f}]"
    text += f" heading {math.degrees(placement.yaw):.0f}°" if turned else ""
    text += f" by {placement.source}, expected {planned}"
    remedy = "put it there, or write where it stands (`star scan --write`)"
    return Finding(agent.name, "start", Severity.ERROR, text, remedy)
