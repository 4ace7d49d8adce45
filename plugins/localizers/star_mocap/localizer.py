"""Positions by motion capture, with odometry between its measurements."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from star_core import (
    Array,
    Corrections,
    Estimate,
    Mask,
    PoseFixes,
    Registry,
    Rows,
    Scene,
    Supervisor,
    Telemetry,
    Transform,
)
from star_core.toolkit import SurfaceHeights, records, shortlist, wrap_angle, yaw_from_quaternion
from star_mocap.forwarding import Forwarding
from star_mocap.identities import UNKNOWN, assign, gates
from star_mocap.kernel import COLUMNS, FILTER, QX, QZ, YAW, correct, move, positions_at
from star_mocap.odometry import LAG_STD, REPORT_STD, START_STD
from star_mocap.source import MocapSourceSpec
from star_mocap.time_offset import Latency, TimeOffset

if TYPE_CHECKING:
    from star_mocap.system import MapFrame

START_YAW: Final = math.radians(2.0)  # rad, std of its heading
FIRST_TIME: Final = 1.0  # s of the mission, in which the first measurements arrive
REPORTED_STD: Final = 5e-3  # s, of a latency that is reported
LAG_MEMORY: Final = 1.0  # s
MAX_LATE: Final = 0.5  # s, by which a frame may be older than the newest, as before the flight
GROUND_AGE: Final = 0.3  # s, of a measurement with which an agent may take off
FROZEN: Final = 0.05  # m that an agent flies by odometry while the same position is measured


class Mocap:
    """Fuses measured poses with odometry, in a filter for each agent.

    It begins at the agents' starts. Without measurements the covariance grows by the drift of
    odometry, so a dropout enlarges the distances that agents keep. A row is valid while its report
    is no older than `max_report_age` and its last measurement no older than `max_pose_age`, or
    `GROUND_AGE` on the ground; and none before all agents that report have been measured.

    Args:
        registry: Of the sources.
        scene: Agents.
        max_report_age: Age up to which a report is valid, s.
        max_pose_age: Age up to which a measurement is, s.
        latency: From a measurement without a time to its arrival, s; None estimates it.
        track: ``bodies`` or ``markers``: which measurements of a source are used.
        std: Of the positions of a source along each axis, m.
        yaw_std_deg: Of the headings of a source, degrees.
        correlation_time: Of the error of the positions of a source, s.
        forward: What is sent to the on-board estimators: ``none``, ``extpos`` or ``extpose``.
        forward_rate: How often, 1/s.
        system: Options of the motion-capture system; without a source, the transport measures.
    """

    def __init__(  # noqa: PLR0913 -- one for each option
        self,
        registry: Registry,
        scene: Scene,
        *,
        max_report_age: float,
        max_pose_age: float,
        latency: float | None,
        track: str,
        std: float,
        yaw_std_deg: float,
        correlation_time: float,
        forward: str,
        forward_rate: float,
        **system: Any,
    ) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._max_report_age, self._max_pose_age = max_report_age, max_pose_age
        self._offset = None if latency is not None else TimeOffset(n)
        # Of measurements without a time.
        self._latency = Latency() if latency is None else Latency(latency, 0.0)
        self._markers = track == "markers"
        self._errors = std, math.radians(yaw_std_deg), correlation_time
        self._filters = records(n, FILTER)
        self._state, self._covariance = self._filters["state"], self._filters["covariance"]
        self._state[:, :3] = np.array([agent.start for agent in scene.agents])
        self._state[:, YAW] = [agent.yaw for agent in scene.agents]
        self._covariance[:, range(3), range(3)] = START_STD**2
        self._covariance[:, YAW, YAW] = START_YAW**2
        # The last finite position and yaw in the odometry frame.
        self._reported = np.zeros((n, 3))
        self._heading = np.zeros(n)
        self._measured = np.full(n, -np.inf)  # s, of the last measurement
        self._last_fix = np.full((n, 3), np.nan)  # m, the last measured position, and by odometry
        self._since_fix = np.full((n, 3), np.nan)  # m, where the agent was when it was new
        self._all_seen = False
        self._velocities: deque[tuple[float, Array]] = deque()  # s, m/s in the map
        self._lost = np.zeros(n, np.bool_)  # agents whose loss was reported
        self._exchanged: Mapping[int, int] = {}  # agents by the labels that they have
        self._offset_reported = False
        self._messages: list[str] = []
        self._surfaces = SurfaceHeights(scene)
        self._forwarding = None
        if forward != "none":
            self._forwarding = Forwarding(scene, forward_rate, turns=forward == "extpose")
        move(self._filters, np.full((n, COLUMNS), np.nan))  # compiles, never in flight
        self._correct(PoseFixes.none(), np.zeros(0))
        positions_at(self._filters, 0.0)
        self._began: float | None = None  # mission time 0 on the computer's clock, s
        self._system = None
        if system.get("source"):
            self._system = MocapSourceSpec.connect(registry, scene, system)

    def close(self) -> None:
        """Disconnect from the motion-capture system."""
        if self._system is not None:
            self._system.close()

    def locate(self, telemetry: Telemetry) -> Estimate:
        heading = telemetry.heading
        finite = np.isfinite(telemetry.position.sum(axis=1) + telemetry.velocity.sum(axis=1))
        finite &= np.isfinite(heading + telemetry.age)
        below = self._surfaces.correct(telemetry, self._state[:, :3], self._covariance[:, :3, :3])
        moves = below.telemetry.velocity
        report = np.column_stack(
            [telemetry.time - telemetry.age, below.telemetry.position, moves, heading]
        )
        if self._forwarding is not None:
            self._forwarding.dead_reckon(report)
        move(self._filters, np.ascontiguousarray(report))
        speed = np.where(finite, np.linalg.norm(telemetry.velocity, axis=1), 0.0)
        fixes = self._identified(self._received(telemetry), speed)
        new, fresh = self._changed(fixes, report[:, QX : QZ + 1], telemetry.state)
        self._note_latency(telemetry, fixes.of(new))
        timed, lag = self._timed(fixes, speed)
        np.maximum.at(self._measured, timed.agent[fresh], timed.time[fresh])
        timed = timed.of(new)
        self._correct(timed, lag[new])
        self._reported = np.where(finite[:, None], telemetry.position, self._reported)
        self._heading = np.where(finite, heading, self._heading)
        turn = wrap_angle(self._state[:, YAW] - self._heading)
        level = Transform(turn, np.zeros_like(self._reported))
        translation = self._state[:, :3] - level.turn(self._reported)
        velocity = np.where(finite[:, None], level.turn(moves), 0.0)
        lag = self._lag_variance(telemetry.time, velocity)
        heard = finite & (telemetry.age <= self._max_report_age)
        valid = heard & self._fresh(telemetry, heard)
        late = np.where(heard, telemetry.age, 0.0)
        frames = Transform(turn, translation)
        corrections = Corrections.none()
        if self._forwarding is not None:
            corrections = self._forwarding.corrections(telemetry.time, timed, velocity)
        messages, self._messages = (*self._messages, *below.messages), []
        return Estimate(
            time=telemetry.time,
            position=self._state[:, :3] + late[:, None] * velocity,
            velocity=velocity,
            yaw=wrap_angle(self._state[:, YAW]),
            covariance=self._covariance[:, :3, :3]
            + (REPORT_STD**2 + lag)[:, None, None] * np.eye(3),
            valid=valid,
            map_from_odom=frames,
            corrections=corrections,
            messages=messages,
            heights=below.heights,
        )

    def _received(self, telemetry: Telemetry) -> PoseFixes:
        """Return the measurements of a tick in the order of their arrival, finite ones only."""
        fixes = telemetry.fixes
        if self._system is not None:
            age = np.min(telemetry.age, initial=np.inf, where=np.isfinite(telemetry.age))
            frames = self._system.take()
            if not (math.isfinite(age) and frames):
                return PoseFixes.none()
            began = self._system.now() - telemetry.time - float(age)
            # the least: a tick that is late gives a later one
            self._began = began if self._began is None else min(began, self._began)
            recent = [frame for frame in frames if frame.arrived > frames[-1].arrived - MAX_LATE]
            fixes = self._fixes(recent, self._began)
        good = np.isfinite(fixes.position.sum(axis=1) + fixes.time + fixes.position_std)
        rows = np.flatnonzero(good)
        return fixes.of(rows[np.argsort(fixes.time[rows], kind="stable")])

    def _fixes(self, frames: list[MapFrame], began: float) -> PoseFixes:
        """Return the measurements of a source's frames; `began` is mission time 0, s."""
        tables = []
        for frame in frames:
            if self._markers:
                agent = np.full(len(frame.markers), UNKNOWN)
                poses = np.column_stack([frame.markers, np.full((len(agent), 4), np.nan)])
            else:
                agent = np.flatnonzero(np.isfinite(frame.poses[:, 0]))
                poses = frame.poses[agent]
            column = np.ones(len(agent))
            std, yaw_std, correlation_time = self._errors
            tables.append(
                PoseFixes(
                    agent=agent,
                    taken=(frame.taken - began) * column,
                    arrived=(frame.arrived - began) * column,
                    position=poses[:, :3],
                    attitude=poses[:, 3:],
                    position_std=std * column,
                    attitude_std=yaw_std * column,
                    correlation_time=correlation_time * column,
                )
            )
        return PoseFixes.merged(tables)

    def _identified(self, fixes: PoseFixes, speed: Array) -> PoseFixes:
        """Return the measurements that are of an agent, with the right one."""
        if not len(fixes.agent):
            return fixes
        late, uncertain = self._latency
        time = np.where(np.isfinite(fixes.taken), fixes.taken, fixes.arrived - late)
        timed = bool(np.isfinite(fixes.taken).all())
        located = np.isfinite(self._measured)
        agent = fixes.agent.copy()
        exchanged: dict[int, int] = {}
        for at in np.unique(time):
            rows = np.flatnonzero(time == at)
            predicted = positions_at(self._filters, at)
            gate = gates(
                self._covariance[:, :3, :3],
                float(fixes.position_std[rows].max()),
                0 * speed if timed else speed * uncertain,
                located,
            )
            agent[rows], wrong = assign(agent[rows], fixes.position[rows], predicted, gate)
            exchanged |= wrong
        self._note_exchange(exchanged)
        kept = np.flatnonzero(agent != UNKNOWN)
        return replace(fixes.of(kept), agent=agent[kept])

    def _changed(self, fixes: PoseFixes, flown: Array, state: Rows) -> tuple[Rows, Rows]:
        """Return the rows of measurements that are not repeated, and of those that may be right.

        Some systems repeat the last pose of a body that they have lost. In flight, a position that
        is that of the measurement before it corrects nothing, and a body whose agent flies away
        from it is lost.

        Args:
            fixes: Of agents.
            flown: (N, 3) positions by odometry, m.
            state: (N,) bits of `Supervisor`.
        """
        order = np.argsort(fixes.agent, kind="stable")
        agent, position = fixes.agent[order], fixes.position[order]
        before = np.roll(position, 1, axis=0)
        first = np.diff(agent, prepend=-1) != 0
        before[first] = self._last_fix[agent[first]]
        changed = np.zeros(len(order), np.bool_)
        changed[order] = (position != before).any(axis=1)
        self._last_fix[agent] = position
        moved = fixes.agent[changed]
        self._since_fix[moved] = flown[moved]
        flying = state & int(Supervisor.FLYING) != 0
        away = flying & (np.linalg.norm(flown - self._since_fix, axis=1) > FROZEN)
        usable = changed | ~flying[fixes.agent]
        return np.flatnonzero(usable), np.flatnonzero(changed | ~away[fixes.agent])

    def _note_exchange(self, exchanged: Mapping[int, int]) -> None:
        """Report labels of other agents, once for each exchange."""
        names = self._scene.names
        for label, agent in exchanged.items():
            if self._exchanged.get(label) != agent:
                self._messages.append(
                    f"motion capture exchanges bodies: that of {names[label]!r} is {names[agent]!r}"
                )
        self._exchanged = exchanged

    def _note_latency(self, telemetry: Telemetry, fixes: PoseFixes) -> None:
        """Estimate the latency of measurements without a time, and report the first estimate."""
        offset = self._offset
        if offset is None or not len(fixes.agent) or np.isfinite(fixes.taken).any():
            return
        offset.add(telemetry.time, telemetry.odometry, fixes)
        self._latency = seconds, std = offset.latency
        if std <= REPORTED_STD and not self._offset_reported:
            self._offset_reported = True
            self._messages.append(
                f"motion capture is {1e3 * seconds:.0f} ms late (± {1e3 * std:.0f} ms), by speeds"
            )

    def _timed(self, fixes: PoseFixes, speed: Array) -> tuple[PoseFixes, Array]:
        """Return measurements with times, and the (K,) variances that uncertain ones add, m²."""
        unknown = ~np.isfinite(fixes.taken)
        late, uncertain = self._latency
        lag = np.where(unknown, speed[fixes.agent] * uncertain, 0.0)
        return replace(fixes, taken=np.where(unknown, fixes.arrived - late, fixes.taken)), lag**2

    def _lag_variance(self, now: float, velocity: Array) -> Array:
        """Return the variance along each axis by the lag of reported velocities: (N,) m².

        Positions are moved on from the last measurement by velocities that lag: they miss the
        change of velocity since then, for as long as the lag.
        """
        self._velocities.append((now, velocity))
        while now - self._velocities[0][0] > LAG_MEMORY:
            self._velocities.popleft()
        times = np.array([time for time, _ in self._velocities])
        tick = np.searchsorted(times, self._measured, side="right") - 1
        velocities = np.array([each for _, each in self._velocities])
        change = velocity - velocities[np.maximum(tick, 0), np.arange(len(velocity))]
        variance: Array = LAG_STD**2 / 3 * np.vecdot(change, change)
        return variance

    def _fresh(self, telemetry: Telemetry, heard: Mask) -> Mask:
        """Return which agents have a new measurement, (N,), and report those that lost theirs."""
        age = telemetry.time - self._measured
        on_ground = telemetry.state & int(Supervisor.FLYING) == 0
        longest = self._max_pose_age
        fresh = age <= np.where(on_ground, min(GROUND_AGE, longest), longest)
        if not self._all_seen:
            self._all_seen = bool(heard.any() and fresh[heard].all())
        lost = heard & ~fresh & (telemetry.time > FIRST_TIME)
        names = self._scene.names
        if news := [names[row] for row in np.flatnonzero(lost & ~self._lost).tolist()]:
            self._messages.append(f"motion capture measures no pose of {shortlist(news)}")
        if news := [names[row] for row in np.flatnonzero(self._lost & fresh).tolist()]:
            self._messages.append(f"motion capture measures {shortlist(news)} again")
        self._lost = (self._lost | lost) & ~fresh
        return fresh & self._all_seen

    def _correct(self, fixes: PoseFixes, variance: Array) -> None:
        """Correct the filters by measurements, in the order of their times.

        Args:
            fixes: Of agents.
            variance: (K,) m², by the uncertainty of their times.
        """
        table = np.column_stack(
            [
                fixes.time,
                fixes.position,
                yaw_from_quaternion(fixes.attitude),
                fixes.position_std,
                fixes.attitude_std,
                fixes.correlation_time,
                variance,
            ]
        )
        correct(self._filters, np.array(fixes.agent), np.ascontiguousarray(table))
