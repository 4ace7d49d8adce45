"""Base stations and anchors of an import: files of cflib and of the Crazyflie client."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from star_core.formats import Value
from star_import.import_log import ImportLog, show
from star_import.text import Line

TYPE: Final = "lighthouse_system_configuration"
VERSION: Final = "1"  # cflib's LighthouseConfigFileManager has no other
STATIONS: Final = 16  # channels of base stations
SKEW: Final = 0.01  # of a rotation matrix, the largest: 0.6°
VERTICAL: Final = 1e-6  # least horizontal length of the direction that is not straight down

Angles = tuple[float, float, float]
Row = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Beacon:
    """A Lighthouse base station or a Loco anchor.

    Attributes:
        kind: ``base_stations`` or ``anchors``.
        name: In the world.
        position: m.
        angles: Roll, pitch and yaw, degrees, as worlds have them; None for an anchor.
        location: Source location, ``file:line:col``.
    """

    kind: str
    name: str
    position: tuple[float, float, float]
    angles: Angles | None
    location: str

    def line(self) -> Line:
        """Return it as a line of a world file."""
        keys = ("roll_deg", "pitch_deg", "yaw_deg")
        turns = [
            f", {key}: {show(angle)}"
            for key, angle in zip(keys, self.angles or (), strict=False)
            if angle
        ]
        at = show([round(value, 4) for value in self.position])
        return Line(f"  {self.name}: {{at: {at}{''.join(turns)}}}", self.location)


def beacons(stations: Value | None, anchors: Value | None, log: ImportLog) -> list[Beacon]:
    """Return the base stations and the anchors; invalid ones are added to the problems of `log`.

    Args:
        stations: Content of a file of cflib's `LighthouseConfigFileManager`, if there is one.
        anchors: Content of a file that the client's tab *Loco Positioning* saves, if there is one.
        log: Log of what is ignored.
    """
    every: list[Beacon] = []
    with log.collected():
        every += _stations(stations, log) if stations is not None else ()
    for number, spec in (anchors.map() if anchors is not None else {}).items():
        with log.collected():
            x, y, z = (spec.need(axis).number() for axis in "xyz")
            every.append(Beacon("anchors", f"a{int(number)}", (x, y, z), None, spec.begins_at))
    return every


def system(every: Sequence[Beacon], log: ImportLog) -> str:
    """Return the positioning system of some beacons; empty if there are none."""
    stations = [beacon for beacon in every if beacon.kind == "base_stations"]
    if stations and len(stations) < len(every):
        text = "the drones are located by base stations; a mission has one localizer for all"
        log.changed(stations[0].location, text)
    return "lighthouse" if stations else "loco" if every else ""


def _stations(file: Value, log: ImportLog) -> Iterator[Beacon]:
    """Yield the base stations of a file.

    Raises:
        InputError: It is of another type or version, or a base station is invalid.
    """
    for key, expected in (("type", TYPE), ("version", VERSION)):
        if (value := file.need(key)).text() != expected:
            raise value.wrong(f"{key} {value.text()!r}, expected {expected!r}")
    geometry = file.need("geos")
    if not geometry.map():
        raise geometry.wrong("has no base stations: estimate their geometry in the client first")
    if "calibs" in file.map():
        log.ignored(file.map()["calibs"].begins_at, "calibrations of base stations stay on board")
    for number, spec in geometry.map().items():
        if not number.isdigit() or int(number) >= STATIONS:
            raise spec.wrong(f"base station {number!r}, expected one from 0 to {STATIONS - 1}")
        x, y, z = _row(spec.need("origin"))
        name = f"bs{int(number) + 1}"  # by its channel, as the client shows it
        yield Beacon("base_stations", name, (x, y, z), _angles(spec), spec.begins_at)


def _angles(spec: Value) -> Angles:
    """Return roll, pitch and yaw, degrees, of a base station.

    Its matrix turns vectors of its own frame, which has x ahead and z up, into those of the room.

    Raises:
        InputError: It is no rotation.
    """
    entry = spec.need("rotation")
    rows = [_row(row) for row in entry.list()]
    if len(rows) != 3 or not _is_rotation(rows):  # noqa: PLR2004 -- axes
        raise entry.wrong("is not a rotation, three orthogonal rows of length 1")
    (xx, xy, _), (yx, yy, _), (zx, zy, zz) = rows
    level = math.hypot(xx, yx)
    if level > VERTICAL:
        roll, yaw = math.atan2(zy, zz), math.atan2(yx, xx)
    else:
        roll, yaw = 0.0, math.atan2(-xy, yy)
    angles = (math.degrees(angle) for angle in (roll, math.atan2(-zx, level), yaw))
    first, second, third = (round(angle, 2) for angle in angles)
    return first, second, third


def _row(entry: Value) -> Row:
    """Return three numbers.

    Raises:
        InputError: There are more or fewer.
    """
    numbers = entry.numbers()
    if len(numbers) != 3:  # noqa: PLR2004 -- coordinates
        raise entry.wrong(f"has {len(numbers)} numbers, expected x, y and z")
    x, y, z = numbers
    return x, y, z


def _is_rotation(rows: Sequence[Row]) -> bool:
    """Return whether rows of a 3x3 matrix are orthogonal, of length 1, and right-handed."""
    a, b, c = rows
    across = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return abs(math.hypot(*a) - 1) < SKEW and abs(math.hypot(*b) - 1) < SKEW and (
        math.dist(across, c) < SKEW
    )  # fmt: skip
