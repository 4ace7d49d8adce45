"""Collects the reports of all drones into one `Telemetry`."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from star_core import Array, Detections, Frames, Odometry, Rows, Supervisor, Telemetry
from star_core.toolkit import Refusal, quaternion_from_euler
from star_radio import report
from star_radio.report import Layout
from star_radio.vehicle import Vehicle


class TelemetryBuffer:
    """Newest reports of all drones.

    Args:
        vehicles: The drone of each row; one that is not connected has no reports.
        in_map: Whether they report the variances of their positions.

    Attributes:
        last: (N, 13) values of the newest reports; columns of `star_radio.report`.
        over_at: (N,) when the climb or trajectory of each drone is over, to which a descent has
            been added, s of the computer's clock.
        lands_by: (N,) when that ends on the ground, s of the computer's clock.
    """

    def __init__(self, vehicles: Sequence[Vehicle], *, in_map: bool = False) -> None:
        self._vehicles, self._in_map = vehicles, in_map
        self.last = np.full((len(vehicles), len(report.SOURCES)), np.nan)
        self.over_at = np.full(len(vehicles), np.inf)
        self.lands_by = np.full(len(vehicles), np.inf)
        self._newest = 0.0  # mission time, s

    def gather(self, began: float, frames: Frames, refusals: tuple[Refusal, ...] = ()) -> Telemetry:
        """Return what arrived since the last call; `began` is mission time 0 on the clock, s."""
        agents, times, values = self._read()
        if len(agents):
            self.last[agents] = values  # the newest row of each drone is last
            self._newest = max(self._newest, float(times.max()) - began)
        now = time.monotonic()
        state = np.nan_to_num(self.last[:, report.STATE]).astype(np.int64)
        active = state & int(Supervisor.COMMANDER_ACTIVE) != 0
        state[active & (now >= self.over_at)] |= int(Supervisor.COMMANDER_FINISHED)
        return Telemetry(
            time=self._newest,
            position=self.last[:, [report.X, report.Y, report.Z]],
            velocity=self.last[:, [report.VX, report.VY, report.VZ]],
            attitude=quaternion_from_euler(
                *self.last[:, [report.ROLL, report.PITCH, report.YAW]].T
            ),
            battery=self.last[:, report.BATTERY],
            state=state,
            age=np.array([now - vehicle.stream.sampled for vehicle in self._vehicles]),
            odometry=odometry(agents, times - began, values),
            frames=frames,
            detections=Detections.none(),
            refusals=refusals,
            signal=self.last[:, report.SIGNAL],
            rebooted=np.array([vehicle.rebooted for vehicle in self._vehicles]),
            lands_by=self.lands_by - began,
            specific_force=np.array(
                [vehicle.accelerometer.newest(now) for vehicle in self._vehicles]
            ),
            position_variance=np.array(
                [vehicle.position_variance.newest(now) for vehicle in self._vehicles]
            )
            if self._in_map
            else None,
        )

    def _read(self) -> tuple[Rows, Array, Array]:
        """Decode the reports that arrived, together for drones with the same layout.

        Returns:
            Rows of the drones, (K,); times, (K,) s of the computer's clock; values, (K, 13) columns
            of `star_radio.report`. They are ordered by drone and time.
        """
        agents: list[int] = []
        times: list[float] = []
        by_layout: dict[Layout, tuple[list[int], list[bytes]]] = {}
        for row, vehicle in enumerate(self._vehicles):
            reports = vehicle.stream.take_all()
            if not reports or vehicle.stream.layout is None:
                continue
            indices, payloads = by_layout.setdefault(vehicle.stream.layout, ([], []))
            for made, payload in reports:
                indices.append(len(agents))
                payloads.append(payload)
                agents.append(row)
                times.append(made)
        values = np.empty((len(agents), len(report.SOURCES)))
        for layout, (indices, payloads) in by_layout.items():
            values[indices] = layout.read(payloads)
        return np.array(agents, np.int64), np.array(times), values


def odometry(agents: Rows, times: Array, values: Array) -> Odometry:
    """Return samples since mission time 0, with velocities turned into the level body frame.

    Args:
        agents: (K,) rows of the drones.
        times: (K,) mission time, s.
        values: (K, 13) columns of `star_radio.report`.
    """
    kept = times >= 0
    values = values[kept]
    yaw = values[:, report.YAW]
    cos, sin = np.cos(yaw), np.sin(yaw)
    east, north = values[:, report.VX], values[:, report.VY]
    ahead, aside = cos * east + sin * north, cos * north - sin * east
    return Odometry(
        agent=agents[kept],
        time=times[kept],
        velocity=np.stack([ahead, aside, values[:, report.VZ]], axis=1),
        yaw_rate=values[:, report.YAW_RATE],
        roll=values[:, report.ROLL],
        pitch=values[:, report.PITCH],
        height=values[:, report.Z],
    )
