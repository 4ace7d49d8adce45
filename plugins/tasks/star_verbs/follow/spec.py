"""The verb ``follow``: its options as JSON Schema, their checks, and the factory of its task."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from star_core import InputError, Problem, TaskSpec
from star_core.toolkit import StepGoal
from star_verbs.positions import (
    SPACING,
    bounded,
    changed,
    exactly_one,
    offsets,
    point,
    spacing_problems,
    speed_problems,
)

if TYPE_CHECKING:
    from star_core import Scene, Task
    from star_verbs.follow.tracking_error import TrackingError
    from star_verbs.follow.trajectory import PolynomialPath

TRAJECTORIES: Final = ("timed", "poly7")  # formats, flown in their own time
FOR_TRAJECTORIES: Final = ("timescale", "relative", "on_board")
FOR_PATHS: Final = ("size", "width", "centre", "laps")
MEMORY: Final = 4096  # bytes of a Crazyflie's trajectory memory
MAX_ERROR: Final = 0.15  # m RMS, expected beside a trajectory without a warning
PIECE_SIZE: Final = 132  # bytes: 33 numbers

OPTIONS: Final = {
    "type": "object",
    "properties": {
        "file": {
            "type": "string",
            "description": "CSV file in the mission's folder, in the given 'format'. Give "
            "this or 'path'.",
            "examples": ["paths/inspection.csv"],
        },
        "format": {
            "enum": ["waypoints", *TRAJECTORIES],
            "description": "Format of the file. waypoints: columns x, y, z in the map, m, and "
            "optionally yaw_deg, degrees. timed: also t, s, at which each point is passed, on a "
            "smooth line. poly7: Crazyswarm2's duration, s, and polynomials of 7th degree for "
            "x, y, z, m, and yaw, rad, flown in the file's own time.",
            "default": "waypoints",
        },
        "timescale": bounded(
            "Factor by which the duration of a timed or poly7 file is stretched: 2 is half as "
            "fast.",
            minimum=0.01,
            default=1.0,
        ),
        "relative": {
            "type": "boolean",
            "description": "Whether a timed or poly7 file begins at each agent's position, "
            "shifted and not rotated; false: it is in the map frame. If not given: true for "
            "poly7, false for timed.",
        },
        "on_board": {
            "type": "boolean",
            "description": "Whether a timed or poly7 file is uploaded to each agent before "
            "take-off and flown by its own commander: exactly in time, not steered by planner or "
            "avoider until it ends. Other agents still give way.",
            "default": False,
        },
        "path": {
            "enum": ["box", "circle", "figure8"],
            "description": "A closed path; the figure 8 is a lemniscate of Gerono along x. "
            "Give this or 'file'.",
            "examples": ["circle"],
        },
        "size": bounded(
            "Side of the box, diameter of the circle, length of the figure 8 along x, m. "
            "Needed with 'path'.",
            minimum=0.01,
            examples=[2.4],
        ),
        "width": bounded(
            "Size of the path along y, m; by default the size, half of it for the figure 8.",
            minimum=0.01,
            examples=[1.2],
        ),
        "centre": point(
            "Center of the path, [x, y, z] in the map, m. Needed with 'path'.",
            [0.0, 0.0, 0.8],
        ),
        "laps": {
            "type": "integer",
            "minimum": 1,
            "description": "Number of laps; with 'path' only.",
            "default": 1,
        },
        "heading": {
            "enum": ["fixed", "along"],
            "description": "Look along the path, or keep the heading (or fly the file's yaw_deg).",
            "default": "fixed",
        },
        "speed": bounded("Speed along the path, m/s; at most limits.speed.", default=0.3),
        "spacing": SPACING,
    },
    "examples": [{"path": "circle", "size": 2.0, "centre": [0.0, 0.0, 0.8]}],
}


def make(scene: Scene, rows: tuple[int, ...], **options: Any) -> Task:
    """Return the task."""
    from star_verbs.follow.follow import Follow, route_reference, trajectory_reference

    reference = trajectory_reference if options["format"] in TRAJECTORIES else route_reference
    along = options["heading"] == "along"
    return Follow(scene, rows, reference(scene, len(rows), options), along=along)


def check(scene: Scene, rows: tuple[int, ...], **options: Any) -> Iterator[Problem]:
    """Yield problems with these options."""
    from star_verbs.follow.trajectory import is_relative

    agents, changes = len(rows), changed(options, OPTIONS)
    is_trajectory = options["format"] in TRAJECTORIES
    if conflicts := list(_trajectory_conflicts(changes) if is_trajectory else _conflicts(changes)):
        yield from conflicts
        return
    if not is_trajectory:
        yield from speed_problems(scene, changes)
    if not (is_trajectory and is_relative(options)) and (
        too_close := list(spacing_problems(scene, agents, options))
    ):
        yield from too_close
        return
    try:
        problems = list((_trajectory_problems if is_trajectory else _route_problems)(
            scene, agents, options
        ))  # fmt: skip
    except InputError as error:
        problems = [Problem(("file",), message, error.code) for message in error.problems]
    yield from problems


def goals(scene: Scene, rows: tuple[int, ...], **options: Any) -> Iterator[StepGoal]:
    """Yield the positions along each agent's line; a relative trajectory's are not known."""
    from star_verbs.follow import routes, trajectory

    key = "file" if "file" in options else "path"
    if options["format"] not in TRAJECTORIES:
        labelled = routes.labelled_positions(routes.route(scene, len(rows), options))
    elif trajectory.is_relative(options):
        return
    else:
        samples = trajectory.Samples.of(_trajectory(scene, options))
        shifts, file = offsets(len(rows), options["spacing"]), options["file"]
        start_only = options["on_board"]  # not planned from there on
        labelled = trajectory.labelled_positions(samples, shifts, file, start_only=start_only)
    yield from (StepGoal((key,), position, label) for label, position in labelled)


def expects(scene: Scene, _rows: tuple[int, ...], **options: Any) -> Iterator[str]:
    """Yield the error with which drones are expected to follow a trajectory."""
    if options["format"] not in TRAJECTORIES:
        return
    error = _tracking_error(_trajectory(scene, options), scene, options)
    where = " on board" if options["on_board"] else ""
    yield f"{options['file']}{where} followed within {error.rms:.2f} m RMS, besides drift"


def _trajectory(scene: Scene, options: dict[str, Any]) -> PolynomialPath:
    from star_verbs.follow.files import read_trajectory

    return read_trajectory(scene.file(options["file"]), options["file"], options["format"])


def _tracking_error(path: PolynomialPath, scene: Scene, options: dict[str, Any]) -> TrackingError:
    from star_verbs.follow.tracking_error import tracking_error

    return tracking_error(path, options["timescale"], scene.period, on_board=options["on_board"])


SPEC: Final = TaskSpec(
    name="follow",
    before="air",
    after="air",
    summary="Fly along a path: a box, a circle, a figure 8, or points from a file.",
    make=make,
    check=check,
    goals=goals,
    expects=expects,
    options=OPTIONS,
)


def _conflicts(options: dict[str, Any]) -> Iterator[Problem]:
    """Check that the options go with waypoints, or with a named path."""
    for key in FOR_TRAJECTORIES:
        if key in options:
            yield Problem(
                (key,), f"{key!r} goes with 'format: timed' or 'poly7' only", "option-conflict"
            )
    if ("file" in options) is ("path" in options):
        yield from exactly_one("file", "path", options)
    elif "path" in options:
        for key in ("size", "centre"):
            if key not in options:
                yield Problem((), f"path {options['path']!r} needs {key!r}", "missing-option")
    else:
        for key in FOR_PATHS:
            if key in options:
                message = f"{key!r} goes with 'path' only, not with 'file'"
                yield Problem((key,), message, "option-conflict")


def _trajectory_conflicts(options: dict[str, Any]) -> Iterator[Problem]:
    """Check that the options go with a trajectory."""
    form = options["format"]
    for key in options:
        if key not in {"format", "file", "spacing", *FOR_TRAJECTORIES}:
            message = f"{key!r} does not go with 'format: {form}'"
            yield Problem((key,), message, "option-conflict")
    if "file" not in options:
        yield Problem((), f"'format: {form}' needs 'file'", "missing-option")


def _route_problems(scene: Scene, agents: int, options: dict[str, Any]) -> Iterator[Problem]:
    """Check that agents on one path keep their distance, and that their lines are flyable."""
    from star_verbs.follow.routes import min_distance, route, route_faults

    name, spacing = options.get("path"), options["spacing"]
    if name is not None and agents > 1:
        nearest = min_distance(name, options["size"], agents, options.get("width"))
        if nearest < spacing:
            message = (
                f"{agents} agents on this {name} come within {nearest:.2f} m of each other, "
                f"less than the spacing of {spacing:g} m"
            )
            yield Problem(("size",), message, "too-close")
    key = "path" if name else "file"
    for fault in route_faults(scene, route(scene, agents, options)):
        yield Problem((key,), fault, "unreachable-goal")


def _imprecise(path: PolynomialPath, scene: Scene, options: dict[str, Any]) -> Iterator[Problem]:
    """Warn of the error with which drones are expected to follow a trajectory, if it is large."""
    error = _tracking_error(path, scene, options)
    if error.rms > MAX_ERROR:
        hint = "or on_board: false makes" if options["on_board"] else "makes"
        message = (
            f"{options['file']}: drones are expected to be {error.rms:.2f} m RMS and up to "
            f"{error.most:.2f} m from where it leads at the time, under the firmware's PID "
            f"controller; a longer timescale {hint} it less"
        )
        yield Problem(("file",), message, "imprecise-trajectory", warning=True)


def _trajectory_problems(scene: Scene, agents: int, options: dict[str, Any]) -> Iterator[Problem]:
    """Check a trajectory; where a relative one leads is checked when it begins."""
    from star_verbs.follow import trajectory

    name, path = options["file"], _trajectory(scene, options)
    size = len(path.lines) * PIECE_SIZE
    if options["on_board"] and size > MEMORY:
        message = (
            f"{name} has {len(path.lines)} pieces of {PIECE_SIZE} bytes, {size} bytes in all; a "
            f"Crazyflie has {MEMORY} bytes for trajectories: {MEMORY // PIECE_SIZE} pieces at most"
        )
        yield Problem(("on_board",), message, "out-of-range")
    if options["on_board"] and not path.turns:
        message = f"{name}: has no column 'yaw_deg', which a flight on board needs"
        yield Problem(("on_board",), message, "missing-option")
    samples = trajectory.Samples.of(path)
    too_fast = list(trajectory.limit_faults(scene, samples, options["timescale"], name))
    for fault in too_fast:
        yield Problem(("file",), fault, "out-of-range")
    if not too_fast:
        yield from _imprecise(path, scene, options)
    if trajectory.is_relative(options):
        faults = trajectory.extent_faults(scene, samples, name)
    else:
        shifts = offsets(agents, options["spacing"])
        faults = trajectory.position_faults(scene, samples, shifts, name)
    yield from (Problem(("file",), fault, "unreachable-goal") for fault in faults)
