"""Firmware parameters in Crazyswarm2's ``crazyflies.yaml``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

from star_core.formats import Value
from star_core.toolkit import shortlist
from star_import.import_log import ImportLog

KEY: Final = "firmware_params"
NAME: Final = re.compile(r"[A-Za-z0-9_]+\.[A-Za-z0-9_]+")
CONTROLLER: Final = "stabilizer.controller"
MELLINGER: Final = 2  # tracks positions: velocity setpoints alone do not steer it


def common_parameters(file: Value, names: Sequence[str], log: ImportLog) -> dict[str, float]:
    """Return the parameters that are equal for all robots, by ``group.name``.

    A robot's own value overrides that of its type, which overrides the one under ``all``. A
    parameter that differs between robots is logged.

    Args:
        file: The file, with maps under ``robots`` and, optionally, ``robot_types`` and ``all``.
        names: Names of the enabled robots.
        log: Log of ignored parameters.

    Raises:
        InputError: A parameter is not a number.
    """
    of_all = _flat(file.map().get("all"))
    types = file.map()["robot_types"].map() if "robot_types" in file.map() else {}
    of_robot: dict[str, Mapping[str, Value]] = {}
    for name in names:
        robot = file.need("robots").map()[name]
        kind = robot.map().get("type")
        of_type = _flat(types.get(kind.text())) if kind is not None else {}
        of_robot[name] = of_all | of_type | _flat(robot)
    common: dict[str, float] = {}
    for key in dict.fromkeys(key for parameters in of_robot.values() for key in parameters):
        robots_by_value: dict[float | None, list[str]] = {}
        for name, parameters in of_robot.items():
            value = parameters[key].number() if key in parameters else None
            robots_by_value.setdefault(value, []).append(name)
        if len(robots_by_value) == 1:
            common[key] = next(parameters[key].number() for parameters in of_robot.values())
            continue
        values = "; ".join(
            f"{'not set' if value is None else plain(value)} for {shortlist(robots)}"
            for value, robots in robots_by_value.items()
        )
        location = next(
            parameters[key].begins_at for parameters in of_robot.values() if key in parameters
        )
        log.add(
            location,
            f"parameter {key} differs between robots ({values}), but the radio transport sets the "
            "same in all; ignored",
        )
    return common


def plain(value: float) -> str:
    """Format a parameter as YAML.

    >>> plain(2.0), plain(0.001), plain(1.5e-7)
    ('2', '0.001', '1.5e-07')
    """
    return f"{value:.9g}"


def _flat(level: Value | None) -> dict[str, Value]:
    """Return the parameters of one level by ``group.name``."""
    if level is None or KEY not in level.map():
        return {}
    parameters: dict[str, Value] = {}
    for group, values in level.map()[KEY].map().items():
        for name, value in values.map().items():
            key = f"{group}.{name}"
            if not NAME.fullmatch(key):
                raise value.wrong(f"{key!r} is not a parameter name")
            value.number()
            parameters[key] = value
    return parameters
