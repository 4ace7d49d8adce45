"""The command ``star land``: lands drones that no program flies any more."""

from __future__ import annotations

import argparse
import sys
import threading
import time
from contextlib import suppress
from typing import Final

import numpy as np

from star_core import Frames, PluginError, Registry
from star_core.commands import add_set_option
from star_core.toolkit import GroundEvidence, Progress, shortlist
from star_radio import budget
from star_radio.connection import udp_links
from star_radio.connection.cflib_link import silence_cflib
from star_radio.connection.link import Link
from star_radio.connection.tables import Tables, user_cache
from star_radio.landings import Landings
from star_radio.options import UNCHANGED
from star_radio.targets import links
from star_radio.telemetry import TelemetryBuffer
from star_radio.vehicle import Vehicle

PERIOD: Final = 0.05  # s, between two steps


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Land drones; return the exit status: 0 if all were reached and are down, else 1.

    Raises:
        InputError: An address is invalid, or the mission is.
    """
    uris = links(options.targets, options.set, registry)
    rescue = Rescue(uris)
    try:
        with Progress("landing", len(uris), unit="drones", detail=rescue.detail) as progress:
            end = time.monotonic() + options.timeout
            with suppress(KeyboardInterrupt):
                while not rescue.step() and time.monotonic() < end:
                    progress.done = rescue.count
                    time.sleep(PERIOD)
    finally:
        rescue.close()
    lines = rescue.lines()
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    return 0 if rescue.count == len(uris) else 1


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Land drones that no program flies any more, straight down. Nothing is reset: "
        "neither estimators nor parameters, and no motor is armed."
    )
    line.epilog = "Exit status: 0 if all drones were reached and are down, otherwise 1."
    line.add_argument(
        "targets",
        nargs="+",
        metavar="MISSION|URI",
        help="mission file (YAML) whose drones are landed, or links such as "
        "radio://0/80/2M/E7E7E7E701",
    )
    add_set_option(line)
    line.add_argument(
        "--timeout",
        type=_positive,
        default=60.0,
        metavar="S",
        help="time to reach and land all drones, s: %(default)g",
    )


def _positive(text: str) -> float:
    number = float(text)
    if not 0 < number < float("inf"):
        raise ValueError(text)
    return number


_positive.__name__ = "positive number"  # as argparse calls it


class Rescue:
    """Connects to drones, and lands those that fly.

    A thread for each drone connects, again until it succeeds. What flies the drone is left alone
    until then: neither its groups nor the priority of setpoints change before it is commanded to
    land.
    """

    def __init__(self, uris: dict[str, str]) -> None:
        silence_cflib()
        n = len(uris)
        self._names, self._uris = list(uris), list(uris.values())
        self._udp_links = udp_links.UdpLinks()
        self._tables = Tables(user_cache())
        self._period = budget.report_period(self._uris, UNCHANGED.mode)
        self._vehicles = [self._vehicle(row) for row in range(n)]
        self._problems = ["no answer"] * n  # why a drone is not reached
        self._reached = np.zeros(n, np.bool_)
        self._lands = np.zeros(n, np.bool_)  # which were commanded to land
        self._height = np.full(n, np.nan)  # m, from which each is landed
        self._ground = GroundEvidence(n)
        self._landings = Landings(self._vehicles, self._ground)
        self._telemetry = TelemetryBuffer(self._vehicles)
        self._began = time.monotonic()
        self._ended = threading.Event()
        self._threads = [threading.Thread(target=self._connect, args=(row,)) for row in range(n)]
        for thread in self._threads:
            thread.start()

    @property
    def count(self) -> int:
        """Number of drones that are known to be down."""
        return int(self._down().sum())

    def detail(self) -> str:
        """Return what is waited for, for the display of progress."""
        missing = [name for name, ok in zip(self._names, self._reached, strict=True) if not ok]
        return f"not reached yet: {shortlist(missing)}" if missing else ""

    def step(self) -> bool:
        """Command what is due; return whether all drones are down."""
        now = time.monotonic()
        reached = np.flatnonzero(self._reached)
        for row in reached.tolist():
            self._vehicles[row].retry(now)
        telemetry = self._telemetry.gather(self._began, Frames.none())
        self._ground.observe(time.monotonic(), telemetry)
        for row in reached.tolist():
            if self._vehicles[row].airborne and not self._lands[row]:
                self._lands[row] = True
                self._height[row] = height = float(telemetry.position[row, 2])
                self._landings.land(row, height)
        self._landings.repeat(telemetry, self._reached & ~self._ground.down(now))
        return bool(self._down().all())

    def lines(self) -> list[str]:
        """Return a line for each drone: what became of it."""
        down, now = self._down(), time.monotonic()
        lines = []
        for row, name in enumerate(self._names):
            height = self._height[row]
            at = "an unknown height" if np.isnan(height) else f"{height:.2f} m"
            if not self._reached[row]:
                what = f"not reached: {self._problems[row]}"
            elif not down[row]:
                what = f"may be in the air: {self._ground.describe(row, now)}"
            else:
                what = f"landed, was flying at {at}" if self._lands[row] else "on the floor"
            lines.append(f"{name}  {what}")
        return lines

    def close(self) -> None:
        """Close the links. Drones whose landing has begun continue it."""
        self._ended.set()
        for thread in self._threads:
            thread.join()
        for vehicle in self._vehicles:
            vehicle.link.close()
        self._udp_links.close()

    def _down(self) -> np.ndarray:
        return self._reached & self._ground.down(time.monotonic())

    def _vehicle(self, row: int) -> Vehicle:
        link = Link(self._uris[row], self._names[row], self._udp_links)
        return Vehicle(self._names[row], link)

    def _connect(self, row: int) -> None:
        """Connect to a drone; runs in its thread."""
        while not self._ended.is_set():
            vehicle = self._vehicle(row)
            try:
                vehicle.connect(UNCHANGED, self._tables, self._period, None)
            except PluginError as error:
                self._problems[row] = error.message
                vehicle.link.close()
            else:
                self._vehicles[row] = vehicle
                self._reached[row] = True
                return
