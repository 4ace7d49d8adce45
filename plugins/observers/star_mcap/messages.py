"""Builds ROS 2 messages and encodes them as CDR."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, Final

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from star_core import Array, Camera

FILE: Final = "flight.mcap"
"""Name of the recording in the folder of a run."""

MAP: Final = "map"
"""Frame of everything that is recorded in the map."""

_APRILTAG: Final = {
    "apriltag_msgs/msg/Point": "float64 x\nfloat64 y\n",
    "apriltag_msgs/msg/AprilTagDetection": (
        "string family\nint32 id\nint32 hamming\nfloat32 goodness\nfloat32 decision_margin\n"
        "apriltag_msgs/Point centre\napriltag_msgs/Point[4] corners\nfloat64[9] homography\n"
    ),
    "apriltag_msgs/msg/AprilTagDetectionArray": (
        "std_msgs/Header header\napriltag_msgs/AprilTagDetection[] detections\n"
    ),
}


@cache
def _store() -> Any:
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, definition in _APRILTAG.items():
        store.register(get_types_from_msg(definition, name))
    return store


def encode(message: Any) -> bytes:
    """Return a message as CDR."""
    return bytes(_store().serialize_cdr(message, message.__msgtype__))


@cache
def definition(name: str) -> bytes:
    """Return the text that defines a message, with those of the messages in it."""
    text: str = _store().generate_msgdef(name, ros_version=2)[0]
    return text.encode()


@cache
def kind(name: str) -> Any:
    """Return the class of a message: ``kind("std_msgs/String")``."""
    package, _, message = name.partition("/")
    return _store().types[f"{package}/msg/{message}"]


def stamp(nanoseconds: int) -> Any:
    """Return a time as a message."""
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return kind("builtin_interfaces/Time")(seconds, rest)


def header(nanoseconds: int, frame: str = MAP) -> Any:
    """Return the header of a message."""
    return kind("std_msgs/Header")(stamp(nanoseconds), frame)


def vector(values: Iterable[float]) -> Any:
    """Return x, y, z as a Vector3."""
    return kind("geometry_msgs/Vector3")(*values)


def point(values: Iterable[float]) -> Any:
    """Return x, y, z as a Point."""
    return kind("geometry_msgs/Point")(*values)


def pose(position: Iterable[float], attitude: Iterable[float] = (0.0, 0.0, 0.0, 1.0)) -> Any:
    """Return a pose; the attitude is a unit quaternion x, y, z, w."""
    return kind("geometry_msgs/Pose")(point(position), kind("geometry_msgs/Quaternion")(*attitude))


def pose_stamped(
    time: int, position: Iterable[float], attitude: Iterable[float] = (0.0, 0.0, 0.0, 1.0)
) -> Any:
    """Return a pose in the map."""
    return kind("geometry_msgs/PoseStamped")(header(time), pose(position, attitude))


def path(time: int, points: Iterable[Iterable[float]]) -> Any:
    """Return a path in the map; its attitudes are level."""
    return kind("nav_msgs/Path")(header(time), [pose_stamped(time, point) for point in points])


def transform(
    time: int, parent: str, child: str, position: Sequence[float], attitude: Sequence[float]
) -> Any:
    """Return the pose of the frame `child` in the frame `parent`."""
    motion = kind("geometry_msgs/Transform")(
        vector(position), kind("geometry_msgs/Quaternion")(*attitude)
    )
    return kind("geometry_msgs/TransformStamped")(header(time, parent), child, motion)


def twist_stamped(time: int, velocity: Iterable[float]) -> Any:
    """Return a velocity in the map."""
    twist = kind("geometry_msgs/Twist")(vector(velocity), vector((0.0, 0.0, 0.0)))
    return kind("geometry_msgs/TwistStamped")(header(time), twist)


def camera_info(time: int, frame: str, camera: Camera) -> Any:
    """Return the intrinsics of a camera: OpenCV's pinhole model, distortion k1, k2, p1, p2, k3."""
    fx, fy, cx, cy = camera.matrix
    return kind("sensor_msgs/CameraInfo")(
        header=header(time, frame),
        height=camera.height,
        width=camera.width,
        distortion_model="plumb_bob",
        d=np.array(camera.distortion),
        k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], float),
        r=np.eye(3).ravel(),
        p=np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], float),
        binning_x=0,
        binning_y=0,
        roi=kind("sensor_msgs/RegionOfInterest")(0, 0, 0, 0, False),  # noqa: FBT003 -- a message
    )


def odometry(
    time: int,
    child: str,
    position: Sequence[float],
    attitude: Sequence[float],
    velocity: Sequence[float],
    pose_covariance: Array,
    twist_covariance: Array,
) -> Any:
    """Return a pose in the map and a velocity in the frame `child`; covariances are (36,)."""
    with_covariance = kind("geometry_msgs/PoseWithCovariance")
    twist = kind("geometry_msgs/Twist")(vector(velocity), vector((0.0, 0.0, 0.0)))
    return kind("nav_msgs/Odometry")(
        header(time),
        child,
        with_covariance(pose(position, attitude), pose_covariance),
        kind("geometry_msgs/TwistWithCovariance")(twist, twist_covariance),
    )
