"""Localizer ``mocap``: poses measured by motion capture, fused with odometry; and its sources."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from star_core import LocalizerSpec, Problem, deferred, hookimpl
from star_core.toolkit import KindSpec, number, positive
from star_mocap.source import MocapSourceSpec

if TYPE_CHECKING:
    from star_core import Registry, Scene

HOST: Mapping[str, Any] = {
    "type": "string",
    "minLength": 1,
    "description": "Host of the server.",
    "examples": ["192.168.1.10"],
}
PORT: Mapping[str, Any] = {"type": "integer", "minimum": 1, "maximum": 65535}

OPTIONS: dict[str, Any] = {
    "track": {
        "enum": ["bodies", "markers"],
        "default": "bodies",
        "description": "What a source measures of the agents: 'bodies' with names, or 'markers', "
        "one on each agent, which are assigned by their positions.",
    },
    "latency": {
        "type": ["number", "null"],
        "minimum": 0,
        "maximum": 1,
        "default": None,
        "description": "Time from a measurement to its arrival, s, for those without a time; null "
        "estimates it in flight.",
    },
    "std": number(
        "Standard deviation of a source's positions along each axis, m.",
        minimum=1e-4,
        maximum=1,
        default=0.002,
    ),
    "yaw_std_deg": number(
        "Standard deviation of a source's headings, degrees.", minimum=0.01, maximum=90, default=0.5
    ),
    "correlation_time": number(
        "Time constant with which the error of a source's positions changes, s.",
        minimum=0,
        maximum=3600,
        default=1.0,
    ),
    "max_pose_age": positive(
        "Age up to which a measured pose is valid, s: an agent flies on odometry for so long, and "
        "is not located after it.",
        default=0.5,
    ),
    "max_report_age": positive("Age up to which an agent's report is valid, s.", default=0.5),
    "forward": {
        "enum": ["none", "extpos", "extpose"],
        "default": "none",
        "description": "What is sent to the on-board estimators: nothing, measured positions, or "
        "poses.",
    },
    "forward_rate": positive(
        "How often it is sent to each agent, 1/s; no more than once a tick.",
        maximum=100,
        default=10.0,
    ),
}


def check(
    registry: Registry,
    scene: Scene,
    *,
    bodies: Mapping[str, str],
    source: Mapping[str, Any] | None = None,
    **_options: Any,
) -> Iterable[Problem]:
    """Require one source of measured poses, and a body for each agent."""
    if source is None:
        if not scene.measures_positions:
            yield Problem(
                (),
                "nothing measures positions; name the system by `source:`, in simulation write "
                "transport: {use: sim, positioning: {std: 0.002}}, or use localizer flow or "
                "apriltag",
                "no-positioning",
            )
    elif not scene.realtime:
        text = (
            "a source sends frames in real time, which this transport does not fly in; in "
            "simulation, remove it and write transport: {use: sim, positioning: {std: 0.002}}"
        )
        yield Problem(("source",), text, "option-conflict")
    else:
        options = {"source": source, "bodies": bodies}
        yield from MocapSourceSpec.check(registry, scene, options)


@hookimpl
def star_kinds() -> Iterable[KindSpec]:
    yield KindSpec(name="mocap_source", record=MocapSourceSpec)


@hookimpl
def star_mocap_sources() -> Iterable[MocapSourceSpec]:
    yield MocapSourceSpec(
        name="motioncapture",
        summary="Labelled bodies of Vicon, VRPN, OptiTrack, Qualisys and others, without times.",
        frames="star_mocap.sources.vendors:frames",
        package=("motioncapture", "motioncapture"),
        options={
            "required": ["type", "host"],
            "properties": {
                "type": {
                    "type": "string",
                    "minLength": 1,
                    "description": "Type of the system, as the package motioncapture names it: "
                    "'vicon', 'vrpn', 'optitrack', 'qualisys', ...",
                    "examples": ["vicon"],
                },
                "host": HOST,
            },
        },
    )
    yield MocapSourceSpec(
        name="natnet",
        summary="OptiTrack's Motive: labelled bodies and markers, with times.",
        frames="star_mocap.sources.natnet:frames",
        package=("natnet", "'star-swarm[mocap]'"),
        options={
            "required": ["host"],
            "properties": {
                "host": HOST,
                "multicast": {
                    "type": "boolean",
                    "default": True,
                    "description": "Whether Motive streams by multicast, as it does by default.",
                },
                "command_port": {
                    **PORT,
                    "default": 1510,
                    "description": "Motive's command port.",
                },
            },
        },
    )
    yield MocapSourceSpec(
        name="qtm",
        summary="Qualisys Track Manager: labelled bodies and markers, with times.",
        frames="star_mocap.sources.qtm:frames",
        package=("qtm_rt", "'star-swarm[mocap]'"),
        options={
            "required": ["host"],
            "properties": {
                "host": HOST,
                "port": {**PORT, "default": 22223, "description": "Port of little-endian data."},
            },
        },
    )
    yield MocapSourceSpec(
        name="mock",
        summary="Bodies that are made up, to try a mission file without a system.",
        frames="star_mocap.sources.made:mock",
        options={
            "required": ["bodies"],
            "properties": {
                "bodies": {
                    "type": "object",
                    "minProperties": 1,
                    "additionalProperties": {
                        "type": "array",
                        "items": {"type": "number"},
                        "minItems": 3,
                        "maxItems": 3,
                    },
                    "description": "Position of each body, m.",
                    "examples": [{"cf1": [0, 0, 0]}],
                },
                "rate": positive("Frames, 1/s.", maximum=1000, default=100.0),
                "radius": number(
                    "Radius of the circle that each flies, m.", minimum=0, maximum=100, default=0.0
                ),
                "period": positive("Time of a round, s.", default=10.0),
                "labelled": {
                    "type": "boolean",
                    "default": True,
                    "description": "Whether the bodies have names; otherwise they are markers.",
                },
            },
        },
    )
    yield MocapSourceSpec(
        name="replay",
        summary="Frames that were recorded, at the times at which they were.",
        frames="star_mocap.sources.made:replay",
        files=("file",),
        options={
            "required": ["file"],
            "properties": {
                "file": {
                    "type": "string",
                    "minLength": 1,
                    "description": "CSV file with the columns time,body,x,y,z,qx,qy,qz,qw; a "
                    "marker has no body and no quaternion.",
                    "examples": ["poses.csv"],
                },
                "repeat": {
                    "type": "boolean",
                    "default": False,
                    "description": "Whether to begin again at its end.",
                },
            },
        },
    )


@hookimpl
def star_localizers(registry: Registry) -> Iterable[LocalizerSpec]:
    yield LocalizerSpec(
        name="mocap",
        summary="Fuse poses measured by motion capture with on-board odometry.",
        make=partial(deferred("star_mocap.localizer:Mocap"), registry),
        options={
            "type": "object",
            "properties": OPTIONS | MocapSourceSpec.system_options(registry),
        },
        check=partial(check, registry),
        corrects_heights=True,
        edge_clearance=0.5,  # benchmarks/heights.py
        drift=deferred("star_mocap.odometry:expected_std"),
    )
