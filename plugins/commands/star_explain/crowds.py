"""Goals that are nearer to each other than core and avoider keep agents apart."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from star_core import AgentPhase, Mission, Problem
from star_core.toolkit import Rehearsal, actions
from star_explain.origins import Origins
from star_explain.separation import kept_distance

ARRIVED: Final = 0.1  # m, by which an agent that has arrived may be nearer to others than its goal
AT_GOAL: Final = 0.25  # m from its goal; an agent farther away had not arrived when its step ended
NO_DISTANCE: Final = 1e-6  # m, rounding error of a position


def crowd_problems(mission: Mission, rehearsal: Rehearsal, origins: Origins) -> Iterator[Problem]:
    """Warn of agents whose goals after a step of the mission are too near to each other.

    Between these steps all agents hover, and avoid agents that have landed. Each pair is reported
    once. Agents that may be elsewhere than in the rehearsal are not considered.
    """
    scene, limits = mission.scene, mission.scene.limits
    kept = kept_distance(mission)
    beside = max(limits.separation, kept - ARRIVED)
    semi_axes = np.array([beside, beside, limits.vertical_separation])
    if not semi_axes.all():
        return
    away = set(mission.reserve_rows)  # that have not joined, or have left
    reported: set[tuple[int, int]] = set()
    for node, uncertain in zip(mission.steps, origins.uncertain, strict=True):
        rounds = [step for action in actions([node]) for step in origins.rounds.get(id(action), ())]
        for step in rounds:
            away -= set(step.rows)
            away |= set(step.rows) if step.action.verb == "leave" else set()
        if not rounds:
            continue
        last = max(rounds, key=lambda step: step.ended)
        end, goal = rehearsal.index(last.ended), rehearsal.last_goals(last)
        flying = rehearsal.phase[end] == AgentPhase.FLYING
        position = rehearsal.position[end]
        left = np.linalg.norm(goal - position, axis=1)  # m to go; NaN without a goal
        position = np.where((flying & (left < AT_GOAL))[:, None], goal, position)
        rows = [row for row in range(len(flying)) if flying[row] or row not in away]
        rows = [row for row in rows if row not in uncertain]
        offset = position[rows][:, None] - position[rows]  # (K, K, 3)
        near = np.linalg.norm(offset / semi_axes, axis=2) < 1 - NO_DISTANCE
        near &= flying[rows][:, None] | flying[rows]
        for i, j in np.argwhere(np.triu(near, 1)).tolist():
            pair = rows[i], rows[j]
            if pair in reported:
                continue
            reported.add(pair)
            first, second = (scene.agents[row].name for row in pair)
            apart = float(np.linalg.norm(offset[i, j]))
            yield Problem(
                tuple(node.at),
                f"{first} and {second} have goals {apart:.2f} m from each other after this step; "
                f"core and avoider keep agents at one height {kept:g} m apart",
                "too-close",
                warning=True,
            )
