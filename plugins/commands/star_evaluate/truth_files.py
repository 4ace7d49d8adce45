"""Reads ground truth: TUM trajectories, tables as CSV, and ROS 2 messages in MCAP files."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from star_core import Array, InputError
from star_core.toolkit import suggestion

TUM: Final = (".tum", ".txt")
NANO: Final = 1e-9
TIMES: Final = ("time", "t", "timestamp")


def read_truth(path: Path, bodies: Mapping[str, str], topic: str) -> dict[str, Array]:
    """Return the true positions of agents: by name (K, 4) times, s, and x, y, z, m.

    Args:
        path: A file, or a folder with a TUM file ``BODY.tum`` for each agent.
        bodies: Name of each agent's body in the file.
        topic: Of an agent's poses in an MCAP file, with ``{}`` for its body.

    Raises:
        InputError: A file cannot be read, or two agents have the same body; the message locates
            what is wrong.
    """
    agents = {body: agent for agent, body in bodies.items()}
    for agent, body in bodies.items():
        if (other := agents[body]) != agent:
            text = f"body {body!r} is of {agent!r} and of {other!r}; name others by --body"
            raise InputError(text, "duplicate-name")
    try:
        if path.is_dir():
            named = ((agent, _in_folder(path, body)) for agent, body in bodies.items())
            tracks = {agent: _tum(file) for agent, file in named if file is not None}
        elif path.suffix == ".mcap":
            tracks = _mcap(path, bodies, topic)
        elif path.suffix == ".csv":
            tracks = _csv(path, bodies)
        elif path.suffix in TUM:
            if len(bodies) > 1:
                text = f"{path}: a TUM file has one trajectory and the flight {len(bodies)} agents"
                raise InputError(
                    f"{text}; name a folder with AGENT.tum for each", "invalid-trajectory"
                )
            tracks = {agent: _tum(path) for agent in bodies}
        else:
            text = f"{path}: expected a .tum, .txt, .csv or .mcap file, or a folder of .tum files"
            raise InputError(text, "unreadable-file")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {error}", "unreadable-file") from error
    if not tracks:
        text = f"{path}: no trajectory of {', '.join(bodies.values())}"
        raise InputError(text, "no-record")
    return tracks


def _in_folder(folder: Path, body: str) -> Path | None:
    """Return the trajectory of a body in a folder, also as ``star export`` names it."""
    names = (f"{body}.tum", f"{body}-ground_truth.tum", f"{body}.txt")
    return next((folder / name for name in names if (folder / name).is_file()), None)


def _tum(path: Path) -> Array:
    """Return a trajectory of the TUM RGB-D benchmark: lines ``time x y z qx qy qz qw``."""
    rows = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        values = _numbers(words)
        if values is None or len(values) != 8:  # noqa: PLR2004 -- time, position, quaternion
            text = f"{path}:{number}: expected 8 numbers: time x y z qx qy qz qw"
            raise InputError(text, "invalid-trajectory")
        rows.append(values[:4])
    return _track(path, rows)


def _csv(path: Path, bodies: Mapping[str, str]) -> dict[str, Array]:
    """Return the trajectories in a table with columns time, x, y, z, and body if there are more."""
    with path.open(encoding="utf-8", newline="") as lines:
        table = csv.reader(lines)
        header = [name.strip().lower() for name in next(table, [])]
        time = next((header.index(name) for name in TIMES if name in header), None)
        if time is None or not {"x", "y", "z"} <= {*header}:
            raise InputError(f"{path}:1: expected columns time, x, y, z", "invalid-trajectory")
        columns = [time, *(header.index(axis) for axis in "xyz")]
        body = header.index("body") if "body" in header else None
        if body is None and len(bodies) > 1:
            text = f"{path}:1: the flight has {len(bodies)} agents: expected a column body"
            raise InputError(text, "invalid-trajectory")
        agents = {name: agent for agent, name in bodies.items()}
        rows: dict[str, list[list[float]]] = {}
        for number, row in enumerate(table, 2):
            values = _numbers([row[k] for k in columns]) if len(row) == len(header) else None
            if values is None:
                raise InputError(f"{path}:{number}: expected numbers", "invalid-trajectory")
            agent = agents.get(row[body]) if body is not None else next(iter(bodies))
            if agent is not None:
                rows.setdefault(agent, []).append(values)
    return {agent: _track(path, of_agent) for agent, of_agent in rows.items()}


def _mcap(path: Path, bodies: Mapping[str, str], topic: str) -> dict[str, Array]:
    """Return the trajectories of stamped poses, transforms or odometry in an MCAP file."""
    if find_spec("rosbags") is None:
        text = f"{path}: MCAP files need rosbags: pip install 'star-swarm[record]'"
        raise InputError(text, "missing-package")
    from rosbags.highlevel import AnyReader, AnyReaderError

    topics = {topic.format(body): agent for agent, body in bodies.items()}
    rows: dict[str, list[list[float]]] = {}
    try:
        with AnyReader([path]) as reader:
            chosen = [each for each in reader.connections if each.topic in topics]
            if not chosen:
                recorded = sorted({each.topic for each in reader.connections})
                hint = suggestion(next(iter(topics)), recorded, "there are", 10)
                text = f"{path}: no topic {next(iter(topics))!r}{hint}; name it by --topic"
                raise InputError(text, "no-record")
            for connection, _, data in reader.messages(connections=chosen):
                message: Any = reader.deserialize(data, connection.msgtype)
                rows.setdefault(topics[connection.topic], []).append(_stamped(message))
    except (AnyReaderError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: {error}", "unreadable-file") from error
    return {agent: _track(path, of_agent) for agent, of_agent in rows.items()}


def _stamped(message: Any) -> list[float]:
    """Return time, s, and position, m, of a message with a header."""
    stamp = message.header.stamp
    if hasattr(message, "transform"):
        point = message.transform.translation
    else:
        pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
        point = pose.position
    return [stamp.sec + NANO * stamp.nanosec, point.x, point.y, point.z]


def _numbers(words: Sequence[str]) -> list[float] | None:
    try:
        values = [float(word) for word in words]
    except ValueError:
        return None
    return values if all(map(math.isfinite, values)) else None


def _track(path: Path, rows: Sequence[Sequence[float]]) -> Array:
    """Return (K, 4) samples in the order of their times, each time once."""
    if len(rows) < 2:  # noqa: PLR2004 -- for an interpolation
        raise InputError(f"{path}: a trajectory has fewer than two poses", "invalid-trajectory")
    track = np.array(rows, float)
    _, first = np.unique(track[:, 0], return_index=True)
    return track[first]


def pairs(texts: Sequence[str], names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield agents and their bodies from texts ``AGENT=BODY``.

    Raises:
        InputError: There is no such agent.
    """
    for text in texts:
        agent, equals, body = text.partition("=")
        if agent not in names or not (equals and body):
            hint = suggestion(agent, names, "there are")
            raise InputError(f"--body {text}: no agent named {agent!r}{hint}", "unknown-agent")
        yield agent, body
