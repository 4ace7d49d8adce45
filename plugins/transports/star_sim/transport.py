"""The simulator of the transport ``sim``: its clock, links and ground truth."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from star_core import (
    Array,
    Command,
    ContractError,
    Corrections,
    Detections,
    Frames,
    Odometry,
    Order,
    PluginError,
    PoseFixes,
    Scene,
    Setpoint,
    Supervisor,
    Telemetry,
    Trajectory,
    Truth,
)
from star_core.toolkit import Fault, every, freeze, frozen, some
from star_sim import commander
from star_sim.aerodynamics import COLUMNS, Wind
from star_sim.airframe import STEP, STEPS_PER_CYCLE
from star_sim.camera_sim.options import CameraOptions
from star_sim.cascade import CONTROLLERS, Cascades, cascades
from star_sim.contact import SWEEP, prisms
from star_sim.discharge import HOVER_CURRENT, VOLTAGE_OF_CHARGE
from star_sim.drone import OFF, know_map, standing, without_flow_deck
from star_sim.drone_faults import DroneFaults
from star_sim.error_profile import ErrorProfile
from star_sim.estimator import SAMPLE
from star_sim.fusion import Fusion
from star_sim.inertial_fusion import InertialFusion
from star_sim.kernel import BLOCK, advance, report
from star_sim.onboard import Onboard
from star_sim.pieces import Piece, Queue, pieces_of
from star_sim.positioning import Positioning
from star_sim.radio_link import RadioLink
from star_sim.sensors import (
    NOISE_STREAM,
    TEXTURE_POINTS,
    WANDERING,
    Wander,
    draw_errors,
    draw_texture,
    streams,
)
from star_sim.steering import Steering

MIN_SWAP_CHARGE = 0.95  # fraction of full: batteries with more are not replaced


class Simulator:
    """Simulated Crazyflies, in lock-step: the same scene and options give the same numbers.

    `star_sim.commander` documents the reaction to commands, setpoints, and their absence. Telemetry
    contains each drone's on-board estimate in its odometry frame, at the end of the last complete
    cycle of 10 ms; it equals the ground truth only if `noise` is off.

    Args:
        scene: Agents, world and seed.
        noise: Whether estimates have errors; drones then also start slightly off their positions.
        controller: Name in `star_sim.cascade.CONTROLLERS`, or ``ideal``.
        profile: Magnitudes of the errors of sensors and radio link; whether there are downwash and
            ground effect.
        battery: Initial charge, as a fraction of full.
        endurance: Hover time with a full battery, s.
        swap_time: Time on the ground until a battery is replaced, s; None never replaces one.
        speed: As the attribute, at the start.
        camera: Camera error model; None disables cameras.
        wind: Velocity, gusts and their correlation time: see `star_sim.aerodynamics.Wind`.
        positioning: Options of a positioning system: see `star_sim.positioning`; None has none.
        onboard: Options of receivers on board: see `star_sim.onboard`; None has none.
        needs_images: Whether the images of the agent in a row are needed; others are not rendered.

    Attributes:
        speed: Mission seconds per second of wall time; None is as fast as possible.
        cascades: (N,) state of the firmware's controllers; None with ``ideal``.
        onboard: Receivers of a positioning system; None without, or without noise.
        leads: (N, 3) state of Mellinger's; with None no drone may have this controller.
    """

    def __init__(  # noqa: PLR0913 -- one for each option
        self,
        scene: Scene,
        *,
        noise: bool,
        controller: str,
        profile: ErrorProfile,
        battery: float,
        endurance: float,
        swap_time: float | None = None,
        speed: float | None = None,
        camera: CameraOptions | None = None,
        wind: Mapping[str, Any] | None = None,
        positioning: Mapping[str, Any] | None = None,
        onboard: Mapping[str, Any] | None = None,
        needs_images: Callable[[int], bool] = lambda _row: True,
    ) -> None:
        n = len(scene.agents)
        self._cameras = None
        if camera is not None and any(agent.camera for agent in scene.agents):
            from star_sim.camera_sim.cameras import Cameras

            self._cameras = Cameras(scene, camera, needs_images)
        self._scene = scene
        self._noise = noise
        self.speed = speed
        self._pace = Pace()
        self._step = 0
        self.drones = standing(
            np.array([agent.start for agent in scene.agents], float).reshape(n, 3),
            np.array([agent.yaw for agent in scene.agents], float),
            battery,
        )
        self.drones["capacity"] = HOVER_CURRENT * endurance
        self.cascades: Cascades | None = None
        self.leads = np.zeros((n, 3)) if controller == "mellinger" else None
        if controller != "ideal":
            self.cascades = cascades(n, CONTROLLERS[controller])
        self._steering = Steering(
            self.drones, self.leads, scene.period, ideal=controller == "ideal"
        )
        self._swap_time = swap_time
        self._grounded_since = np.full(n, np.nan)  # s, of drones that have flown
        self._texture = np.zeros((TEXTURE_POINTS, TEXTURE_POINTS))
        self._streams: list[np.random.Generator] = []
        if noise:
            draw_errors(self.drones, profile, scene.seed)
            self._texture = draw_texture(scene.seed)
            self._streams = streams(scene.seed, NOISE_STREAM, n)
        self._order = np.argsort(self.drones["position"] @ SWEEP, kind="stable")
        self._keys = np.zeros(n)
        self.fusion: Fusion | InertialFusion = Fusion(n)
        self._normals = np.zeros((BLOCK, n, 4))
        self._samples = np.zeros((BLOCK, n, SAMPLE))
        self._arrived: list[Array] = []  # (N, SAMPLE) of each cycle since the last `receive`
        self._wander = Wander(profile, scene.seed, n) if noise and profile.imu else None
        # (BLOCK, N, WANDERING) errors of the current block.
        self._imu = None if self._wander is None else np.zeros((BLOCK, n, WANDERING))
        self._boxes, self._spans, self._edges = prisms(scene.world)
        lossy = profile.report_loss or profile.setpoint_loss
        imperfect = noise and (lossy or profile.report_delay or profile.setpoint_delay)
        self._link = RadioLink(profile, scene.seed, n) if imperfect else None
        self._wind = None if wind is None else Wind(**wind, seed=scene.seed, agents=n)
        self._positioning = Positioning(scene.seed, n, **positioning) if positioning else None
        self.onboard = self._receivers(**onboard) if onboard else None
        devices = self._cameras, self._positioning, self.onboard
        self._devices = [device for device in devices if device is not None]
        self._near = np.zeros((n, COLUMNS)) if profile.aerodynamics else None
        still = np.zeros((BLOCK, n, 3))
        self._air = None if wind is None and self._near is None else still  # of the current block
        self._uploaded: dict[Trajectory, tuple[Piece, ...]] = {}
        self._queue = Queue(self.drones)
        self._lands_by = np.full(n, np.inf)  # s, of what was commanded last to be flown on board
        self._faults: DroneFaults | None = None

    def _receivers(self, *, system: str, flow_deck: bool = True) -> Onboard | None:
        """Return receivers of a positioning system, which estimates begin with; exact need none."""
        know_map(self.drones)
        if not self._noise:
            return None
        if not flow_deck:
            without_flow_deck(self.drones)
            self.fusion = InertialFusion(len(self.drones))
        self.fusion.start_unknown()
        return Onboard(self._scene, self.fusion, system=system)

    @property
    def time(self) -> float:
        """Mission time, s."""
        return self._step * STEP

    @property
    def sample(self) -> Array:
        """(N, SAMPLE) output of the estimators; columns as in `star_sim.estimator.believe`."""
        row: Array = self._samples[(self._step // STEPS_PER_CYCLE - 1) % BLOCK]
        return row

    def connect(self) -> None:
        """Compile the inner loop before the first tick."""
        self._advance(0)
        still = Setpoint.none(len(self.drones))
        commander.take(self.drones, still.velocity, still.yaw, still.active, 0.0)
        if self._cameras is not None:
            self._cameras.compile(self.drones)
        self.receive()

    def inject(self, faults: Sequence[Fault]) -> None:
        """Simulate faults of motors, batteries, sensors and positioning from now on.

        Raises:
            PluginError: There is no positioning system, or no noise; see `DroneFaults`.
        """
        measuring = [fault for fault in faults if fault.component == "positioning"]
        measures = self._positioning or self.onboard
        if measures is not None:
            measures.faults = measuring
        elif measuring:
            raise PluginError(
                "simulates no faults of positioning without `positioning` or `onboard`"
            )
        others = [fault for fault in faults if fault.component != "positioning"]
        self._faults = DroneFaults(self.drones, others, self._scene.seed, noise=self._noise)

    def upload(self, trajectories: Sequence[Trajectory]) -> None:
        """Store trajectories for later commands."""
        self._uploaded = {trajectory: pieces_of(trajectory) for trajectory in trajectories}

    def wait(self, until: float) -> float:
        """Simulate whole steps of 2 ms up to mission time `until`, s, or the next step after it."""
        end = math.ceil(until / STEP - 1e-6)
        if self._faults is not None:
            self._faults.apply(self._step * STEP)
        self._steering.level(self._step * STEP)
        while self._step < end:
            if self._queue.next_step <= self._step:
                self._queue.advance(self._step)
            due = min(end, self._queue.next_step)
            if self._link is not None:
                self._link.deliver(self._step)
                due = min(due, self._link.next_step, self._queue.next_step)
            for device in self._devices:
                device.take(self.drones, self._step)
                due = min(due, device.next_step)
            cycle = self._step // STEPS_PER_CYCLE
            if self._step % (STEPS_PER_CYCLE * BLOCK) == 0:
                self._draw()
            full = (cycle // BLOCK + 1) * BLOCK * STEPS_PER_CYCLE
            steps = min(due, full) - self._step
            self._advance(steps)
            self._step += steps
            rows = self._step // STEPS_PER_CYCLE - cycle
            if rows:
                first = cycle % BLOCK
                self._arrived.extend(self._samples[first : first + rows].copy())
        now = self._step * STEP
        if self._swap_time is not None:
            self._replace_batteries(now, self._swap_time)
        self._pace.keep(now, self.speed)
        return now

    def receive(self) -> Telemetry:
        drones, n = self.drones, len(self.drones)
        attitude, state = np.empty((n, 4)), np.empty(n, np.int64)
        now = self._step * STEP
        report(drones, now, attitude, state)
        coming_down = self._queue.coming_down()
        if some(coming_down):
            state[coming_down] |= int(Supervisor.COMMANDER_FINISHED)
        odometry = self._odometry()
        if self._link is not None:
            position, velocity, attitude, age, force = self._link.reports(now)
        else:
            position, velocity = (
                drones["believed_position"].copy(),
                drones["believed_velocity"].copy(),
            )
            age, force = np.zeros(n), self.sample[:, 11:].copy()
        frames, detections = Frames.none(), Detections.none()
        if self._cameras is not None:
            frames, detections = self._cameras.arrived(now)
        battery, lands_by = drones["voltage"].copy(), self._lands_by.copy()
        freeze(position, velocity, attitude, battery, state, age, lands_by, force)
        return Telemetry(
            time=self._step // STEPS_PER_CYCLE * STEPS_PER_CYCLE * STEP,
            position=position,
            velocity=velocity,
            attitude=attitude,
            battery=battery,
            state=state,
            age=age,
            odometry=odometry,
            frames=frames,
            detections=detections,
            fixes=self.fixes(),
            lands_by=lands_by,
            specific_force=force,
            position_variance=self._position_variance(now),
        )

    def _position_variance(self, now: float) -> Array | None:
        """Return the variances of the estimated positions, (N, 3) m²; None without receivers."""
        if self.onboard is None:
            return None
        return frozen(self.fusion.position_variance(self.drones, now))

    def fixes(self) -> PoseFixes:
        """Return what the positioning system has measured, and has arrived since the last call."""
        if self._positioning is None:
            return PoseFixes.none()
        return self._positioning.arrived(self._step * STEP)

    def command(self, command: Command) -> None:
        if command.trajectory is not None and command.trajectory not in self._uploaded:
            raise ContractError("Command.trajectory was not uploaded")
        self._send(lambda: self._obey(command))

    def _send(self, effect: Callable[[], None]) -> None:
        """Cause an effect at the drones, at once or when the radio link delivers it."""
        if self._link is None:
            effect()
        else:
            self._link.send(self._step, effect)

    def _obey(self, command: Command) -> None:
        if command.trajectory is not None:
            self._follow(command, command.trajectory)
            return
        if command.order is not Order.ARM:
            self._queue.drop(command.agent)
        now = self._step * STEP
        commander.obey(self.drones, command, now)
        if command.order is Order.TAKEOFF:
            able = commander.can_fly(self.drones, command.agent)
            for row in command.agent[able].tolist():
                self._lands_by[row] = self._queue.come_down_from_climb(row, now)
        elif command.order is Order.GOTO:
            self._lands_by[command.agent] = np.inf

    def correct(self, corrections: Corrections) -> None:
        """Pass poses to the on-board estimators; without noise they are ignored."""
        if self._noise:
            now = self._step * STEP
            self._send(lambda: self.fusion.take(self.drones, corrections, now))

    def send(self, setpoint: Setpoint) -> Setpoint:
        """Fly the active rows; like the firmware, without clipping velocity setpoints.

        Raises:
            ContractError: A velocity or yaw of an active row is not finite.
        """
        finite = np.isfinite(setpoint.velocity.sum(axis=1) + setpoint.yaw)
        if not every(finite | ~setpoint.active):
            rows = np.flatnonzero(setpoint.active & ~finite)
            raise ContractError(f"the setpoint of {self._scene.named(rows)} is not finite")
        active = setpoint.active
        if self._link is not None:
            active = frozen(self._link.heard(active))
        velocity = self._steering.velocity(setpoint)
        self._send(lambda: self._steering.take(setpoint, velocity, active, self._step * STEP))
        return setpoint

    def truth(self) -> Truth | None:
        columns = [self.drones[name].copy() for name in ("position", "velocity", "attitude")]
        freeze(*columns)
        return Truth(self._step * STEP, *columns)

    def close(self) -> None:
        """Nothing to release."""

    def _follow(self, command: Command, trajectory: Trajectory) -> None:
        """Start a trajectory whose origin is at the position and yaw in the command."""
        able = commander.can_fly(self.drones, command.agent)
        stretch = command.duration / trajectory.duration.sum()
        for i in np.flatnonzero(able).tolist():
            pieces = [
                piece.slower(float(stretch[i])).moved(command.position[i], float(command.yaw[i]))
                for piece in self._uploaded[trajectory]
            ]
            row, now = int(command.agent[i]), self._step * STEP
            self._queue.fly(row, pieces, now)
            over = now + float(command.duration[i])
            self._lands_by[row] = self._queue.come_down(
                row, pieces[-1].at(math.inf)[0], over, self._scene.limits.height[1]
            )

    def _advance(self, steps: int) -> None:
        advance(
            self.drones,
            self.cascades,
            self.leads,
            self._order,
            self._keys,
            self._normals,
            self._texture,
            self._boxes if len(self._boxes) else None,
            self._spans,
            self._edges,
            self._samples,
            self._imu,
            self._air,
            self._near,
            self._step,
            steps,
            self._noise,
        )

    def _draw(self) -> None:
        """Draw the random numbers of the next block of cycles."""
        for row, stream in enumerate(self._streams):
            self._normals[:, row] = stream.standard_normal((BLOCK, 4))
        if self._wander is not None:
            self._imu = self._wander.block(BLOCK)
        if self._wind is not None:
            self._air = self._wind.block(BLOCK)

    def _replace_batteries(self, now: float, duration: float) -> None:
        """Give full batteries to drones that have been on the ground for `duration`, s."""
        drones = self.drones
        grounded = (drones["mode"] == OFF) & (drones["charge"] < MIN_SWAP_CHARGE)
        self._grounded_since = np.where(grounded, np.fmin(self._grounded_since, now), np.nan)
        replaced = now - self._grounded_since >= duration
        drones["charge"][replaced] = 1.0
        drones["voltage"][replaced] = VOLTAGE_OF_CHARGE[-1]

    def _odometry(self) -> Odometry:
        samples, self._arrived = self._arrived, []
        if self._link is not None:
            agent, arrived = self._link.receive(samples)
        else:
            agent = np.tile(np.arange(len(self.drones)), len(samples))
            arrived = np.array(samples).reshape(-1, SAMPLE)
        columns = [*map(np.array, (agent, arrived[:, 0], arrived[:, 1:4], *arrived[:, 4:8].T))]
        freeze(*columns)
        return Odometry(*columns)


class Pace:
    """Slows a simulation down to a speed, which may change at any time."""

    def __init__(self) -> None:
        self._speed: float | None = None
        self._begun = self._last = (0.0, 0.0)  # s: mission time and wall time

    def keep(self, now: float, speed: float | None) -> None:
        """Sleep until mission time `now`, s, is due; do not sleep if `speed` is None."""
        clock = time.monotonic()
        if speed != self._speed:
            self._speed = speed
            self._begun = self._last if self._last[0] else (0.0, clock)
        if speed is not None:
            mission, wall = self._begun
            time.sleep(max(0.0, wall + (now - mission) / speed - clock))
        self._last = now, time.monotonic()
