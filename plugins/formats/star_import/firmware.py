"""Firmware parameters in the files of Crazyswarm2 and Crazyswarm."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Final

from star_core.formats import Value

KEYS: Final = ("firmware_params", "firmwareParams")
NAME: Final = re.compile(r"[A-Za-z0-9_]+\.[A-Za-z0-9_]+")
CONTROLLER: Final = "stabilizer.controller"
MELLINGER: Final = 2  # tracks positions: velocity setpoints alone do not steer it
CONTROLLERS: Final = {0: "pid", 1: "pid", MELLINGER: "mellinger"}
"""Controllers of the simulator, by the value of the firmware's parameter."""

Parameters = Mapping[str, float]


def parameters(levels: Iterable[Value | None]) -> dict[str, float]:
    """Return the parameters of a robot by ``group.name``; a later level overrides earlier ones.

    Args:
        levels: What may have parameters, such as the file's ``all``, a type and a robot.

    Raises:
        InputError: A parameter is not a number.
    """
    values: dict[str, float] = {}
    for level in levels:
        if level is None:
            continue
        for key in KEYS:
            groups = level.map().get(key)
            if groups is not None:
                values |= _flat(groups)
    return values


def common(of_robots: Iterable[Parameters]) -> dict[str, float]:
    """Return the parameters that are equal for all robots.

    >>> common([{"a.b": 1.0, "a.c": 2.0}, {"a.b": 1.0, "a.c": 3.0}])
    {'a.b': 1.0}
    """
    first, *others = [*of_robots] or [{}]
    return {key: value for key, value in first.items() if all(o.get(key) == value for o in others)}


def plain(value: float) -> str:
    """Format a parameter as YAML.

    >>> plain(2.0), plain(0.001), plain(1.5e-7)
    ('2', '0.001', '1.5e-07')
    """
    return f"{value:.9g}"


def _flat(groups: Value) -> dict[str, float]:
    """Return the parameters of one level by ``group.name``."""
    flat: dict[str, float] = {}
    for group, values in groups.map().items():
        for name, value in values.map().items():
            key = f"{group}.{name}"
            if not NAME.fullmatch(key):
                raise value.wrong(f"{key!r} is not a parameter name")
            flat[key] = value.number()
    return flat
