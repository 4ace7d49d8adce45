"""What drones on the ground report of themselves: nothing is reset, armed or flown."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final, Self

from star_core import Frames, PluginError
from star_core.toolkit import Progress, shortlist
from star_radio import budget, report
from star_radio.connection import packets, udp_links
from star_radio.connection.cflib_link import silence_cflib
from star_radio.connection.link import Link
from star_radio.connection.tables import Tables, user_cache
from star_radio.options import UNCHANGED
from star_radio.telemetry import TelemetryBuffer
from star_radio.vehicle import Vehicle, close_all

DECK: Final = "deck.bc"  # with which the names of the parameters of decks begin
SELF_TEST: Final = "system.selftestPassed"
REVISION: Final = ("firmware.revision0", "firmware.revision1", "firmware.modified")
STATIONS: Final = {"Lighthouse4": "lighthouse.bsActive", "Loco": "ranging.state"}
"""By deck of a positioning system, the bits of the stations or anchors that it uses."""
POSITION_VARIANCES: Final = ("kalman.varX", "kalman.varY")  # m²
ECHOES: Final = 200  # by which a link without a dongle is measured
ECHO_PERIOD: Final = 0.005  # s
ECHO_TIMEOUT: Final = 1.0  # s, for the last ones


@dataclass(frozen=True, slots=True)
class Equipment:
    """What a drone consists of, and whether it works.

    Attributes:
        decks: Names of its decks, as in the firmware's parameters; None if it names none.
        self_test: Whether it passed its self-test; None if it does not report that.
        revision: The first six digits of its firmware's revision, ``+`` if modified; may be empty.
    """

    decks: tuple[str, ...] | None = None
    self_test: bool | None = None
    revision: str = ""

    @classmethod
    def read(cls, vehicle: Vehicle) -> Equipment:
        """Ask a connected drone; this blocks."""
        decks = [name for name in vehicle.parameters if name.startswith(DECK)]
        values = vehicle.read_parameters([*decks, SELF_TEST, *REVISION])
        attached = tuple(sorted(name.removeprefix(DECK) for name in decks if values.get(name)))
        passed = values.get(SELF_TEST)
        first, _, modified = (int(values.get(name, 0)) for name in REVISION)
        return cls(
            attached if decks else None,
            None if passed is None else passed != 0,
            f"{first:08x}"[:6] + "+" * bool(modified) if first else "",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """The condition of one drone.

    Attributes:
        uri: Address of its link.
        firmware: Name of its version, and its revision.
        protocol: Version of its protocol.
        equipment: Decks and self-test.
        battery: V.
        state: Bits of its supervisor.
        position: By its estimator, m.
        tilt: Angle of its z axis to the vertical, rad.
        yaw: By its estimator, rad.
        position_std: Of the position along x or y, the greater one, m; NaN if not reported.
        quality: Of its link, %: see `link_quality`.
        signal: dBm; NaN if not reported.
        stations: Bits of the stations of each of its positioning systems, by deck.
        unsettled: Why its estimator has not converged; empty if it has.
    """

    uri: str
    firmware: str
    protocol: int
    equipment: Equipment
    battery: float
    state: int
    position: tuple[float, float, float]
    tilt: float
    yaw: float
    position_std: float
    quality: float
    signal: float
    stations: Mapping[str, int]
    unsettled: str

    @property
    def knows_map(self) -> bool:
        """Whether its estimator has absolute positions, by a positioning system on board."""
        return any(self.stations.values())


class Inspector:
    """Connects to drones, and inspects them in parallel.

    Attributes:
        vehicles: The drones by name.
        faults: By name, why a drone is not reached or does not answer.
    """

    def __init__(self, uris: Mapping[str, str]) -> None:
        silence_cflib()
        self._udp_links = udp_links.UdpLinks()
        self._tables = Tables(user_cache())
        self._period = budget.report_period([*uris.values()], UNCHANGED.mode)
        self.vehicles = {
            name: Vehicle(name, Link(uri, name, self._udp_links)) for name, uri in uris.items()
        }
        self.faults: dict[str, str] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        close_all(self.vehicles.values(), Vehicle.end_reports)
        for vehicle in self.vehicles.values():
            vehicle.link.close()
        self._udp_links.close()

    def inspect(self, *, settle: bool) -> dict[str, Inspection]:
        """Return the condition of each drone that is reached; `settle` waits for estimators."""
        results: dict[str, Inspection] = {}

        def call(name: str) -> None:
            vehicle = self.vehicles[name]
            try:
                vehicle.connect(UNCHANGED, self._tables, self._period, None)
                results[name] = inspection(vehicle, settle=settle)
            except PluginError as error:
                self.faults[name] = error.message
            progress.done += 1

        def detail() -> str:
            return f"waiting for {shortlist(set(self.vehicles) - set(results) - set(self.faults))}"

        n = len(self.vehicles)
        with (
            Progress("inspecting", n, unit="drones", detail=detail) as progress,
            ThreadPoolExecutor(n) as pool,
        ):
            list(pool.map(call, self.vehicles))
        return {name: results[name] for name in self.vehicles if name in results}


def inspection(vehicle: Vehicle, *, settle: bool) -> Inspection:
    """Return the condition of a connected drone; this blocks."""
    equipment = Equipment.read(vehicle)
    decks = equipment.decks or ()
    stations = {deck: name for deck, name in STATIONS.items() if deck in decks}
    values = vehicle.read_log([*POSITION_VARIANCES, *stations.values()])
    variance = max((values.get(name, math.nan) for name in POSITION_VARIANCES), default=math.nan)
    unsettled = ""
    if settle:
        try:
            vehicle.settle()
        except PluginError as error:
            unsettled = error.message
    buffer = TelemetryBuffer([vehicle])
    quality = link_quality(vehicle.link)
    buffer.gather(time.monotonic(), Frames.none())
    (last,) = buffer.last.tolist()
    name = " ".join(filter(None, (vehicle.firmware(), equipment.revision)))
    return Inspection(
        uri=vehicle.link.uri,
        firmware=name,
        protocol=vehicle.version,
        equipment=equipment,
        battery=last[report.BATTERY],
        state=0 if math.isnan(last[report.STATE]) else int(last[report.STATE]),
        position=(last[report.X], last[report.Y], last[report.Z]),
        tilt=math.acos(math.cos(last[report.ROLL]) * math.cos(last[report.PITCH])),
        yaw=last[report.YAW],
        position_std=math.sqrt(max(0.0, variance)) if math.isfinite(variance) else math.nan,
        quality=quality,
        signal=last[report.SIGNAL],
        stations={deck: int(values.get(variable, 0)) for deck, variable in stations.items()},
        unsettled=unsettled,
    )


def link_quality(link: Link) -> float:
    """Return the dongle's quality of a link, %, and without one the share of echoes that return.

    Over a dongle, which repeats lost packets and is shared, no echoes are sent.
    """
    if not math.isnan(link.quality):
        return link.quality
    sent = []
    for _ in range(ECHOES):
        sent.append(time.monotonic())
        link.post(packets.echo(sent[-1]))
        time.sleep(ECHO_PERIOD)
    end = time.monotonic() + ECHO_TIMEOUT
    while (back := len(set(sent) & {*link.echoes})) < ECHOES and time.monotonic() < end:
        time.sleep(ECHO_PERIOD)
    return 100.0 * back / ECHOES
