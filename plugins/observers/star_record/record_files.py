"""Reads the files of a record, which may come from anywhere, within bounds of memory and time."""

from __future__ import annotations

import json
import math
import re
import struct
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final, TypeAlias

import numpy as np

from star_core import Array, ContractError, Rows

MAX_NUMBER: Final = 1e12  # of a summary
MAX_JSON: Final = 100_000_000  # bytes
MAX_ARRAYS: Final = 1 << 30  # bytes of all arrays of a file that is small
MAX_RATIO: Final = 100  # of the arrays of a larger file to the file
MAX_PIXELS: Final = 50_000_000  # of an image
KINDS: Final = "biufU"  # of arrays: truth values, numbers, texts
AGENT: Final = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
MAX_AXES: Final = 3  # ticks, agents, coordinates
PNG_HEAD: Final = 24  # bytes to the end of width and height
PNG: Final = b"\x89PNG\r\n\x1a\n"

Shape: TypeAlias = Any
"""What a value of JSON has to be: of some types, an object with keys, or a list of a shape."""

NUMBER: Final = (float, int)
MAYBE: Final = (float, int, type(None))
SUMMARY: Final[Shape] = {
    **dict.fromkeys(("mission", "outcome", "reason", "distances_from"), str),
    **dict.fromkeys(("seed", "late_ticks"), int),
    "agents": [str],
    "flight_time_s": NUMBER,
    "collisions": {"agent_agent": int, "agent_obstacle": int},
    **dict.fromkeys(("min_separation_m", "min_clearance_m"), MAYBE),
    "targets": {"found": int, "total": int},
    "steps": [
        {"verb": str, "agents": [str], "begun_s": NUMBER, "ended_s": MAYBE, "location?": str}
    ],
    "events": [
        {"time": NUMBER, "kind": str, "text": str, "agent?": str, "details?": {"time_s?": NUMBER}}
    ],
    "compute_s": {...: NUMBER},
}
"""What commands read of a summary with its timing; `...` is any key, one with ``?`` may lack."""
MANIFEST: Final[Shape] = {
    "mission_file": str,
    "plugins": {...: {"name": str, "options": {}}, "avoider": {}},
}


def read_json(file: Path) -> Any:
    """Return the content of a JSON file.

    Raises:
        OSError: It cannot be read.
        ValueError: It is no regular file, or too large, or no JSON.
    """
    return json.loads(regular(file, MAX_JSON).read_text(encoding="utf-8"))


def read_arrays(file: Path) -> dict[str, Any]:
    """Return the arrays of an NPZ file by name; nothing in it is unpickled.

    Raises:
        OSError: It cannot be read.
        ValueError: It is no regular file; a name is not one that a recorder writes, an array is of
            objects or of another size than its header states, or all are larger than memory allows.
    """
    regular(file)
    limit = max(MAX_ARRAYS, MAX_RATIO * file.stat().st_size)
    with file.open("rb") as stream:
        with zipfile.ZipFile(stream) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > limit:
                raise ValueError(f"{file.name} holds more than {limit:.3g} bytes")
            for member in members:
                if not member.filename.removesuffix(".npy").isidentifier():
                    raise ValueError(f"{file.name} has an array {member.filename!r}")
                with archive.open(member) as content:
                    _check_header(content, member.file_size)  # type: ignore[arg-type]
        stream.seek(0)
        with np.load(stream) as arrays:
            return {name: arrays[name] for name in arrays.files}


def _check_header(content: BinaryIO, size: int) -> None:
    """Check the header of an array in a file of a size, before space is made for it."""
    version = np.lib.format.read_magic(content)
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    shape, _order, dtype = read(content)
    if dtype.kind not in KINDS:
        raise ValueError(f"an array of {dtype}")
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != size - content.tell():
        raise ValueError(f"an array of shape {shape} in {size} bytes")


def check_json(value: object, shape: Shape, path: str) -> None:
    """Check a value of JSON, at `path`.

    Raises:
        ContractError: It is not as `shape`; the message names the path.
    """
    match shape:
        case dict():
            if not isinstance(value, Mapping):
                raise ContractError(f"{path} is no object")
            for name, of in _members(value, shape):
                check_json(value.get(name), of, f"{path}.{name}")
        case [of]:
            if not isinstance(value, list):
                raise ContractError(f"{path} is no list")
            for number, item in enumerate(value):
                check_json(item, of, f"{path}.{number}")
        case _:
            if not isinstance(value, shape) or isinstance(value, bool):
                raise ContractError(f"{path} is {value!r:.60}")
            if isinstance(value, float | int) and not abs(value) <= MAX_NUMBER:
                raise ContractError(f"{path} is {value!r:.60}")


def _members(value: Mapping[str, object], shape: Shape) -> Iterator[tuple[str, Shape]]:
    """Yield the keys of an object that have a shape."""
    for key, of in shape.items():
        for name in value if key is ... else (key.removesuffix("?"),):
            if name in value or name == key:
                yield name, of


def check_arrays(arrays: Mapping[str, Array], agents: Sequence[str], swarm: Sequence[str]) -> None:
    """Check that arrays over ticks and agents are those of the agents of a mission.

    Raises:
        ValueError: They are not.
    """
    if tuple(agents) != tuple(swarm) or not all(map(AGENT.fullmatch, agents)):
        raise ValueError("the agents are not those of the mission")
    if not arrays:  # no tick was flown
        return
    time = arrays["time"]
    if time.shape != time.shape[:1] or not (len(time) and np.isfinite(time).all()):
        raise ValueError("'time' is no list of numbers")
    for name, array in arrays.items():
        if name != "time" and (
            array.shape[:2] != (len(time), len(agents)) or array.ndim > MAX_AXES
        ):
            raise ValueError(f"{name!r} has shape {array.shape}")


def check_rows(rows: Rows, agents: int) -> None:
    """Check rows of agents.

    Raises:
        ValueError: One is none of `agents`.
    """
    if len(rows) and not 0 <= rows.min() <= rows.max() < agents:
        raise ValueError(f"a row is none of {agents} agents")


def images(folder: Path, agent: str) -> dict[int, Path]:
    """Return the images of an agent by their times, ms: PNG files of a record's own folder."""
    top = folder.resolve()
    return {
        int(path.stem): path
        for path in sorted(folder.glob(f"frames/{agent}/*.png"))
        if path.stem.isdecimal() and path.resolve().is_relative_to(top) and _is_image(path)
    }


def _is_image(path: Path) -> bool:
    """Whether a file begins as a PNG of a size that a camera may have."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(PNG_HEAD)
    if len(head) < PNG_HEAD or not head.startswith(PNG):
        return False
    width, height = struct.unpack(">II", head[16:])
    return bool(width * height <= MAX_PIXELS)


def regular(file: Path, largest: float = math.inf) -> Path:
    """Return a file that is neither a device nor a pipe, nor larger than that, bytes.

    Raises:
        OSError: It cannot be examined.
        ValueError: It is another one.
    """
    status = file.stat()
    if not file.is_file():
        raise ValueError(f"{file.name} is no regular file")
    if status.st_size > largest:
        raise ValueError(f"{file.name} has more than {largest:.3g} bytes")
    return file
