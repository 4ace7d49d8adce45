"""The command ``star scan``: which drones answer, and what they report of themselves."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from star_core import InputError, PluginError, Registry
from star_core.commands import add_set_option, writing
from star_core.toolkit import log, suggestion
from star_radio.address import RadioAddress
from star_radio.connection.cflib_link import silence_cflib
from star_radio.inspection import Inspection, Inspector
from star_radio.table import aligned
from star_radio.targets import links
from star_radio.vehicle import Vehicle

BLINKS: Final = 8
BLINK_PERIOD: Final = 0.6  # s
LEDS: Final = "led.bitmask"  # bit 7 takes them from the firmware, bits 0 to 5 switch them on
LEDS_ON, LEDS_OFF = 0xBF, 0x80
RING: Final = "ring.effect"
RING_OFF, RING_ON = 0, 7  # effects: none, and one color
COLUMNS: Final = ("drone", "link", "firmware", "battery", "decks", "quality", "signal", "position")


def run(options: argparse.Namespace, registry: Registry) -> int:
    """List drones; return the exit status: 0 if all that were named answer, else 1.

    Raises:
        InputError: An address is invalid, a file exists, or no drone has the name.
    """
    if options.write and Path(options.write).exists():
        text = f"--write {options.write}: it exists; name a new file"
        raise InputError(text, "unwritable-file")
    named = links(options.targets, options.set, registry)
    uris = named or {uri: uri for uri in radio_links(options.address)}
    if not uris:
        log("star: scan: no drone answers: switch them on, or name links or a mission")
        return 1
    if options.blink is not None and options.blink not in uris:
        hint = suggestion(options.blink, [*uris], "there are")
        raise InputError(f"--blink: no drone named {options.blink!r}{hint}", "unknown-agent")
    with Inspector(uris) as inspector:
        inspections = inspector.inspect(settle=False)
        write = _json if options.json else _text
        sys.stdout.write(write(uris, inspections, inspector.faults))
        sys.stdout.flush()
        if options.blink in inspections:
            blink(inspector.vehicles[options.blink], inspections[options.blink])
    if options.write:
        with writing(options.write):
            Path(options.write).write_text(swarm(inspections), encoding="utf-8")
    return 1 if inspector.faults else 0


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "List the drones that answer. Nothing is reset, armed or flown. Without a target, all "
        "channels and data rates are searched for the address by the first Crazyradio."
    )
    line.epilog = "Exit status: 0 if all drones answer, 1 if one or all do not, 2 on bad input."
    line.add_argument(
        "targets",
        nargs="*",
        metavar="MISSION|URI",
        help="mission file (YAML) with the drones' links, or links such as "
        "radio://0/80/2M/E7E7E7E701",
    )
    add_set_option(line)
    line.add_argument(
        "--address",
        action="append",
        type=_address,
        metavar="HEX",
        help="address to search for, such as E7E7E7E701; may be repeated: E7E7E7E7E7",
    )
    line.add_argument(
        "--write",
        metavar="FILE",
        help="write a `swarm` (YAML) with the links, and with start and yaw_deg by the estimators",
    )
    line.add_argument(
        "--blink", metavar="NAME", help="let the LEDs of a drone blink: of an agent, or a link"
    )
    line.add_argument("--json", action="store_true", help="as JSON")


def radio_links(addresses: Sequence[int] | None) -> Iterator[str]:
    """Yield the links at which the first dongle is answered, for each of the addresses."""
    import cflib.crtp
    from cflib.crtp.radiodriver import RadioDriver

    silence_cflib()
    if not cflib.crtp.CLASSES:
        cflib.crtp.init_drivers()
    searched: Sequence[int | None] = addresses or [None]  # None is the address of a new drone
    for address in searched:
        for uri, _text in RadioDriver().scan_interface(address):
            yield str(uri)


def blink(vehicle: Vehicle, inspection: Inspection) -> None:
    """Let the LEDs of a connected drone blink, its ring too, and leave them as they were."""
    ring = "LedRing" in (inspection.equipment.decks or ()) and RING in vehicle.parameters
    if not ring and LEDS not in vehicle.parameters:
        log(f"star: scan: {vehicle.name} has no LEDs that can be set: update its firmware")
        return
    steps = {RING: (RING_ON, RING_OFF)} if ring else {}
    steps |= {LEDS: (LEDS_ON, LEDS_OFF)} if LEDS in vehicle.parameters else {}
    before = vehicle.read_parameters(steps)
    log(f"star: scan: {vehicle.name} blinks for {BLINKS * BLINK_PERIOD:.0f} s")
    try:
        for number in range(2 * BLINKS):
            for name, values in steps.items():
                vehicle.set_parameter(name, values[number % 2])
            time.sleep(BLINK_PERIOD / 2)
    except PluginError as error:
        log(f"star: scan: {vehicle.name}: {error.message}")
    finally:
        for name, value in before.items():
            vehicle.set_parameter(name, value)


def swarm(inspections: Mapping[str, Inspection]) -> str:
    """Return the `swarm` of a mission, YAML."""
    lines = [
        "# Written by `star scan`; paste it into a mission, and name the agents as you like.",
        "swarm:",
    ]
    for number, (name, drone) in enumerate(inspections.items(), 1):
        agent = f"cf{number}" if "://" in name else name
        if any(line.startswith(f"  {agent}:") for line in lines):
            agent = f"cf{number}_"
        x, y = (round(value, 2) + 0.0 for value in drone.position[:2])
        yaw = round(math.degrees(drone.yaw)) + 0
        relative = "" if drone.knows_map else "  # from where it was switched on or reset"
        lines.append(
            f"  {agent}: {{start: [{x}, {y}, 0.0], yaw_deg: {yaw}, uri: {drone.uri!r}}}{relative}"
        )
    return "\n".join(lines) + "\n"


def _text(
    uris: Mapping[str, str], inspections: Mapping[str, Inspection], faults: Mapping[str, str]
) -> str:
    rows = [COLUMNS]
    for name, drone in inspections.items():
        decks = drone.equipment.decks
        x, y, z = drone.position
        where = f"{x:.2f} {y:.2f} {z:.2f} m, {math.degrees(drone.yaw):.0f}°"
        rows.append(
            (
                name,
                _radio(drone.uri) or ("" if name == drone.uri else drone.uri),
                drone.firmware or f"protocol {drone.protocol}",
                f"{drone.battery:.2f} V",
                "unknown" if decks is None else ", ".join(decks) or "none",
                f"{drone.quality:.0f} %",
                "" if math.isnan(drone.signal) else f"{drone.signal:.0f} dBm",
                where if drone.knows_map else f"({where})",
            )
        )
    lines = [*aligned(rows)] if inspections else []
    if any(not drone.knows_map for drone in inspections.values()):
        lines.append("(position): from where the drone was switched on or reset, not in the map")
    lines += [f"{name}  does not answer: {faults[name]}" for name in uris if name in faults]
    return "\n".join(lines) + "\n"


def _radio(uri: str) -> str:
    """Return dongle, channel and rate of a radio's link; empty for others."""
    radio = RadioAddress.of(uri)
    return f"radio {radio.dongle}, channel {radio.channel}, {radio.rate}" if radio else ""


def _json(
    uris: Mapping[str, str], inspections: Mapping[str, Inspection], faults: Mapping[str, str]
) -> str:
    drones = [
        as_record(name, inspections[name])
        if name in inspections
        else {"name": name, "uri": uri, "answers": False, "problem": faults[name]}
        for name, uri in uris.items()
    ]
    return json.dumps({"drones": drones}, indent=2) + "\n"


def as_record(name: str, drone: Inspection) -> dict[str, Any]:
    """Return the condition of a drone, as JSON; what it does not report is null."""
    radio = RadioAddress.of(drone.uri)
    return {
        "name": name,
        "uri": drone.uri,
        "answers": True,
        "radio": radio and {"dongle": radio.dongle, "channel": radio.channel, "rate": radio.rate},
        "firmware": drone.firmware or None,
        "protocol": drone.protocol,
        "battery_v": _number(drone.battery, 3),
        "decks": drone.equipment.decks,
        "self_test": drone.equipment.self_test,
        "link_quality_percent": _number(drone.quality, 1),
        "signal_dbm": _number(drone.signal, 0),
        "position_m": [_number(value, 3) for value in drone.position],
        "position_std_m": _number(drone.position_std, 4),
        "yaw_deg": _number(math.degrees(drone.yaw), 1),
        "in_map": drone.knows_map,
    }


def _number(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


def _address(text: str) -> int:
    number = int(text, 16)
    if not 0 < number < 1 << 40:
        raise ValueError(text)
    return number


_address.__name__ = "address"  # as argparse calls it
