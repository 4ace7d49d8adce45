"""Writes ``flight.mcap``: a flight as ROS 2 messages, complete to within a second at any time."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import numpy as np

from star_core import AgentPhase, Array, Event, Flight, Mask, Paths, Tick, Truth
from star_core.toolkit import messages_from
from star_mcap import messages, writer
from star_mcap.messages import FILE, encode, header, kind, pose_stamped, transform, twist_stamped
from star_mcap.world_markers import world_markers

FLUSH_PERIOD: Final = 1.0  # s of wall time: what a killed program loses at most
BATTERY_PERIOD: Final = 1.0  # s
IMAGE_PERIOD: Final = 0.2  # s, for each camera
PATH_PERIOD: Final = 0.2  # s
WARNINGS: Final = frozenset({"collision", "close_approach", "failure", "late", "slow", "observer"})


class Recorder:
    """Writes every tick of a flight to an MCAP file.

    `docs/record.md` lists the topics. Time stamps are mission time; in real time, they are those of
    the day.

    Args:
        started: When the flight began, ns since 1970.
    """

    def __init__(self, flight: Flight, folder: Path, started: int) -> None:
        scene = flight.scene
        self._names = scene.names
        self._cameras = [agent.camera for agent in scene.agents]
        self._images = flight.save_frames
        self._epoch = started if scene.realtime else 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._last: dict[str, str] = {}  # of topics that are written when they change
        self._next_battery = self._next_paths = -np.inf
        self._planned = Paths.none()  # the latest that were written
        self._next_image = np.full(len(self._names), -np.inf)
        self._in_flight = np.zeros(len(self._names), np.bool_)
        self._unknown = np.zeros(36)
        self._file = (folder / FILE).open("wb")
        self._writer = writer.begin(self._file)
        self._now = self._epoch
        self._write_static(flight)
        self._flushed = 0.0
        self._flush()

    def add(self, tick: Tick) -> None:
        """Write one tick."""
        self._now = self._nanoseconds(tick.time)
        self._write_estimates(tick)
        if tick.truth is not None:
            self._write_truth(tick, tick.truth)
        self._write_setpoints(tick)
        self._write_paths(tick)
        self._write_health(tick)
        self._write_detections(tick)
        if self._images:
            self._write_images(tick)
        if time.monotonic() - self._flushed >= FLUSH_PERIOD:
            self._flush()

    def add_event(self, event: Event) -> None:
        """Write an event."""
        log = kind("rcl_interfaces/Log")
        level = 30 if event.kind in WARNINGS else 20
        now = self._nanoseconds(event.time)
        text = f"{event.agent}: {event.text}" if event.agent else event.text
        self._write("/rosout", log(messages.stamp(now), level, event.kind, text, "", "", 0), now)

    def close(self, summary: Mapping[str, Any]) -> None:
        """Write how the flight ended, the index, and the end of the file."""
        self._writer.add_metadata("summary", {key: str(value) for key, value in summary.items()})
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def _write_static(self, flight: Flight) -> None:
        """Write what does not change: the world, the cameras' poses, the mission."""
        cameras = [
            transform(
                self._now, agent.name, f"{agent.name}/camera",
                agent.camera.position, agent.camera.rotation,
            )
            for agent in flight.scene.agents
            if agent.camera is not None
        ]  # fmt: skip
        self._write("/tf_static", kind("tf2_msgs/TFMessage")(cameras))
        self._write("/world", world_markers(flight.scene, self._now))
        self._writer.add_metadata(
            "mission", {"name": flight.mission, "file": str(flight.manifest["mission_file"])}
        )

    def _write_estimates(self, tick: Tick) -> None:
        """Write estimates and their transforms."""
        estimate = tick.estimate
        attitude = _attitude(estimate.map_from_odom.yaw, estimate.yaw, tick.telemetry.attitude)
        located = estimate.valid & np.isfinite(estimate.position).all(axis=1)
        body = _to_body(attitude, estimate.velocity)
        covariance = np.zeros((len(self._names), 6, 6))
        covariance[:, :3, :3] = estimate.covariance
        flat = covariance.reshape(-1, 36)
        transforms = []
        for i in np.flatnonzero(located):
            name, position, turned = self._names[i], estimate.position[i].tolist(), attitude[i]
            quaternion = turned.tolist()
            transforms.append(transform(self._now, messages.MAP, name, position, quaternion))
            odometry = messages.odometry(
                self._now, name, position, quaternion, body[i].tolist(), flat[i], self._unknown
            )
            self._write(f"/{name}/estimate", odometry)
        if transforms:
            self._write("/tf", kind("tf2_msgs/TFMessage")(transforms))

    def _write_truth(self, tick: Tick, truth: Truth) -> None:
        """Write ground truth; that between take-off and landing also to a topic of its own."""
        phase = tick.health.phase
        flying = phase == AgentPhase.FLYING
        self._in_flight = (self._in_flight | flying) & (flying | (phase == AgentPhase.LOST))
        offset = tick.estimate.position - truth.position
        counted = self._in_flight & np.isfinite(offset).all(axis=1)
        for i in np.flatnonzero(np.isfinite(truth.position).all(axis=1)):
            attitude = truth.attitude[i] if np.isfinite(truth.attitude[i]).all() else (0, 0, 0, 1)
            message = encode(
                pose_stamped(self._now, truth.position[i].tolist(), map(float, attitude))
            )
            name = self._names[i]
            self._write_bytes(f"/{name}/ground_truth", "geometry_msgs/msg/PoseStamped", message)
            if counted[i]:
                topic = f"/{name}/ground_truth/in_flight"
                self._write_bytes(topic, "geometry_msgs/msg/PoseStamped", message)

    def _write_setpoints(self, tick: Tick) -> None:
        for topic, setpoint in (
            ("setpoint/planned", tick.plan.setpoint),
            ("setpoint/sent", tick.sent),
        ):
            for i in np.flatnonzero(setpoint.active):
                message = twist_stamped(self._now, setpoint.velocity[i].tolist())
                self._write(f"/{self._names[i]}/{topic}", message)
        for i in np.flatnonzero(tick.goals.active):
            half = 0.5 * float(tick.goals.yaw[i])
            turned = (0.0, 0.0, float(np.sin(half)), float(np.cos(half)))
            goal = pose_stamped(self._now, tick.goals.position[i].tolist(), turned)
            self._write_changed(f"/{self._names[i]}/goal", goal, str(goal.pose))

    def _write_paths(self, tick: Tick) -> None:
        """Write the planned paths that changed, each from where its agent is."""
        if tick.time < self._next_paths:
            return
        self._next_paths = tick.time + PATH_PERIOD
        position = tick.estimate.position
        planned = tick.plan.paths.beyond(position)
        for row in planned.changed(self._planned).tolist():
            points = planned.of(row)
            points = np.vstack([position[row], points]) if len(points) else points
            path = messages.path(self._now, points.tolist())
            self._write(f"/{self._names[row]}/plan", path)
        self._planned = planned

    def _write_health(self, tick: Tick) -> None:
        for name, phase in zip(self._names, tick.health.phase.tolist(), strict=True):
            self._write_text(f"/{name}/phase", AgentPhase(phase).name)
        self._write_text("/mission/steps", tick.doing)
        if tick.time < self._next_battery:
            return
        self._next_battery = tick.time + BATTERY_PERIOD
        unknown, nothing = float("nan"), np.zeros(0, np.float32)
        for name, voltage in zip(self._names, tick.health.battery.tolist(), strict=True):
            if np.isfinite(voltage):
                battery = kind("sensor_msgs/BatteryState")(
                    header=header(self._now, name),
                    voltage=voltage,
                    temperature=unknown,
                    current=unknown,
                    charge=unknown,
                    capacity=unknown,
                    design_capacity=unknown,
                    percentage=unknown,
                    power_supply_status=2,  # discharging
                    power_supply_health=0,  # unknown
                    power_supply_technology=3,  # LiPo
                    present=True,
                    cell_voltage=nothing,
                    cell_temperature=nothing,
                    location="",
                    serial_number="",
                )
                self._write(f"/{name}/battery", battery)

    def _write_detections(self, tick: Tick) -> None:
        """Write the tags of each image, those that were not used apart, and located targets."""
        detections, images = tick.detections, dict[tuple[int, float, str], list[Any]]()
        point = kind("apriltag_msgs/Point")
        for k, (agent, moment) in enumerate(zip(detections.agent, detections.time, strict=True)):
            topic = "detections/rejected" if detections.rejected[k] else "detections"
            tag = kind("apriltag_msgs/AprilTagDetection")(
                "36h11", int(detections.tag[k]), 0, 0.0, 0.0,
                point(*detections.corners[k].mean(axis=0)),
                [point(*corner) for corner in detections.corners[k].tolist()], np.zeros(9),
            )  # fmt: skip
            images.setdefault((agent, moment, topic), []).append(tag)
        for (agent, moment, topic), tags in images.items():
            frame = f"{self._names[agent]}/camera"
            head = header(self._nanoseconds(moment), frame)
            self._write(
                f"/{frame}/{topic}", kind("apriltag_msgs/AprilTagDetectionArray")(head, tags)
            )
        sightings = tick.estimate.sightings
        for k, agent in enumerate(sightings.agent):
            message = pose_stamped(self._now, sightings.position[k].tolist())
            self._write(f"/{self._names[agent]}/sightings/tag_{sightings.tag[k]}", message)

    def _write_images(self, tick: Tick) -> None:
        import cv2

        frames = tick.telemetry.frames
        for agent, moment, image in zip(
            frames.agent, frames.time.tolist(), frames.image, strict=True
        ):
            if moment < self._next_image[agent]:
                continue
            self._next_image[agent] = moment + IMAGE_PERIOD
            name = self._names[agent]
            encoded, jpeg = cv2.imencode(".jpg", image)
            if encoded:
                at, frame = self._nanoseconds(moment), f"{name}/camera"
                message = kind("sensor_msgs/CompressedImage")(
                    header(at, frame), "jpeg", jpeg.ravel()
                )
                self._write(f"/{name}/camera/image/compressed", message)
                if (camera := self._cameras[agent]) is not None:
                    info = messages.camera_info(at, frame, camera)
                    self._write(f"/{name}/camera/camera_info", info)

    def _write_text(self, topic: str, text: str) -> None:
        """Write a text when it changes."""
        self._write_changed(topic, kind("std_msgs/String")(text), text)

    def _write_changed(self, topic: str, message: Any, content: str) -> None:
        """Write a message if its content is not that of the last one."""
        if self._last.get(topic) != content:
            self._last[topic] = content
            self._write(topic, message)

    def _write(self, topic: str, message: Any, now: int | None = None) -> None:
        self._write_bytes(topic, message.__msgtype__, encode(message), now)

    def _write_bytes(self, topic: str, name: str, data: bytes, now: int | None = None) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            if name not in self._schemas:
                definition = messages.definition(name)
                self._schemas[name] = self._writer.register_schema(name, "ros2msg", definition)
            channel = self._writer.register_channel(topic, "cdr", self._schemas[name])
            self._channels[topic] = channel
        at = self._now if now is None else now
        self._writer.add_message(channel, at, data, at)

    def _flush(self) -> None:
        """Hand everything so far to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._file.flush()
        self._flushed = time.monotonic()

    def _nanoseconds(self, mission_time: float) -> int:
        return self._epoch + max(0, round(1e9 * mission_time))


def _attitude(map_from_odom: Array, yaw: Array, attitude: Array) -> Array:
    """Return attitudes in the map (N, 4) from those in odometry frames; level where not reported.

    Args:
        map_from_odom: (N,) yaw of the odometry frames in the map, rad.
        yaw: (N,) estimated yaw in the map, rad.
        attitude: (N, 4) unit quaternions in the odometry frames.
    """
    half = 0.5 * map_from_odom
    s, c = np.sin(half), np.cos(half)
    x, y, z, w = attitude.T
    turned = np.stack([c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z], axis=1)
    level = np.zeros_like(attitude)
    level[:, 2], level[:, 3] = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
    reported: Mask = np.isfinite(turned).all(axis=1, keepdims=True)
    chosen: Array = np.where(reported, turned, level)
    return chosen


def _to_body(attitude: Array, velocity: Array) -> Array:
    """Return velocities (N, 3) of the map in the bodies whose attitudes are (N, 4)."""
    axis, w = attitude[:, :3], attitude[:, 3:]
    across = np.cross(axis, velocity)
    body: Array = velocity - 2 * w * across + 2 * np.cross(axis, across)
    return body


def serve(descriptor: int) -> None:
    """Record what another process sends: a flight, then lists of ticks and events.

    Its summary completes the file, and so does the end of that process. What fails is the answer.

    Args:
        descriptor: File descriptor of the inherited end of the connection.

    Raises:
        SystemExit: The recording failed.
    """
    connection = Connection(descriptor)
    try:
        _record(messages_from(connection))
    except Exception as error:  # noqa: BLE001 -- the flight reports it
        with suppress(OSError):  # unless it is over
            connection.send(f"{type(error).__name__}: {error}")
        raise SystemExit(1) from None


def _record(messages: Iterator[Any]) -> None:
    recorder = Recorder(*next(messages))
    summary: Mapping[str, Any] = {"outcome": "interrupted"}
    for message in messages:
        if isinstance(message, Mapping):
            summary = message
            break
        for item in message:
            (recorder.add_event if isinstance(item, Event) else recorder.add)(item)
    recorder.close(summary)
