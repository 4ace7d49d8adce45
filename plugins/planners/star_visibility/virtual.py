"""Leads around virtual obstacles where that is possible, and through them where it is not."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from star_core import Estimate, Goals, Mask, Paths, Plan, Scene, Setpoint
from star_visibility.planner import Visibility


def planner(scene: Scene, **options: Any) -> Visibility | AroundVirtual:
    """Return the planner of a scene; the options are those of the schema."""
    if not scene.world.virtual:
        return Visibility(scene, **options)
    return AroundVirtual(scene, options)


class AroundVirtual:
    """Flies agents as if virtual obstacles were there, as long as they can reach their goals.

    An agent that cannot, since it or its goal is in a virtual obstacle or nearer to one than the
    clearances, or since virtual obstacles enclose it, flies as if there were none.

    Args:
        scene: With virtual obstacles.
        options: Of `Visibility`.
    """

    def __init__(self, scene: Scene, options: dict[str, Any]) -> None:
        every = replace(scene.world, obstacles=scene.world.obstacles + scene.world.virtual)
        self._around = Visibility(replace(scene, world=every), **options)
        self._through = Visibility(scene, **options)

    def plan(self, estimate: Estimate, goals: Goals) -> Plan:
        around = self._around.plan(estimate, goals)
        blocked = around.unreachable
        if not blocked.any():
            return around
        through = self._through.plan(estimate, replace(goals, active=goals.active & blocked))
        return Plan(
            _chosen(blocked, through.setpoint, around.setpoint),
            _joined(blocked, through.paths, around.paths),
            unreachable=through.unreachable & blocked,
            reasons=through.reasons,
        )


def _chosen(rows: Mask, setpoint: Setpoint, other: Setpoint) -> Setpoint:
    """Return the setpoints of some rows, and the others of `other`."""
    columns = {}
    for column in fields(Setpoint):
        values, others = getattr(setpoint, column.name), getattr(other, column.name)
        if values is not None:
            columns[column.name] = np.where(
                rows.reshape(-1, *[1] * (values.ndim - 1)), values, others
            )
    return Setpoint(**columns)


def _joined(rows: Mask, paths: Paths, other: Paths) -> Paths:
    """Return the paths of some rows, and the others of `other`."""
    chosen, rest = rows[paths.agent], ~rows[other.agent]
    return Paths(
        agent=np.concatenate([paths.agent[chosen], other.agent[rest]]),
        point=np.concatenate([paths.point[chosen], other.point[rest]]),
    )
