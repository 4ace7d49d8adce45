"""Where the agents are during a dry run, at any time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from star_core import AgentPhase, Array, Mask, Rows, Scene

PERIOD = 0.5  # s, least time between two points of an agent on its way
LONGEST = 1800.0  # s, for which tracks are kept
NO_TIME = 1e-6  # s: rounding error of a clock
AIRBORNE = (AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LANDING)


class Tracks:
    """Positions of all agents over the time of a dry run.

    Args:
        scene: Agents.
    """

    def __init__(self, scene: Scene) -> None:
        self._points: list[list[tuple[float, ...]]] = [
            [(0.0, *agent.start, agent.yaw, 0.0)] for agent in scene.agents
        ]  # of each agent: time, s, x, y, z, m, yaw, rad, and 1 in the air
        self._latest = [points[0] for points in self._points]  # of each agent, not yet kept, maybe

    def marks(self) -> tuple[int, ...]:
        """Return the numbers of points so far, for `repeat`."""
        self._keep_latest(range(len(self._points)))
        return tuple(map(len, self._points))

    def _keep_latest(self, rows: Iterable[int]) -> None:
        """Keep where agents were last, and stay until they move again."""
        for row in rows:
            if self._latest[row][0] > self._points[row][-1][0]:
                self._points[row].append(self._latest[row])

    def add(
        self, time: float, rows: tuple[int, ...], position: Array, yaw: Array, phase: Rows
    ) -> None:
        """Add the positions, (N, 3) m, headings, (N,) rad, and phases, (N,), of some rows."""
        if time > LONGEST:
            return
        for row in rows:
            airborne = float(phase[row] in AIRBORNE)
            if time - self._latest[row][0] > PERIOD:  # it waited there
                self._keep_latest([row])
            last = self._points[row][-1]
            x, y, z = position[row].tolist()
            self._latest[row] = (time, x, y, z, float(yaw[row]), airborne)
            if time - last[0] > PERIOD - NO_TIME or airborne != last[-1]:
                self._points[row].append(self._latest[row])

    def repeat(self, marks: tuple[int, ...], times: int, period: float) -> None:
        """Append what was added since `marks` again, every `period` s, `times` times in all."""
        self._keep_latest(range(len(self._points)))
        for points, mark in zip(self._points, marks, strict=True):
            once = points[mark:]
            for k in range(1, times):
                if not once or once[0][0] + k * period > LONGEST:
                    break
                points.extend((time + k * period, *rest) for time, *rest in once)
        self._latest = [points[-1] for points in self._points]

    def sampled(self, period: float) -> tuple[Array, Array, Array, Mask]:
        """Return times, (T,) s, positions, (T, N, 3) m, headings, (T, N) rad, and flight, (T, N).

        Between two points, an agent is on the line between them; after the last, it stays.
        """
        self._keep_latest(range(len(self._points)))
        end = max(points[-1][0] for points in self._points)
        time = np.arange(0.0, end + period, period)
        tables = [np.array(points) for points in self._points]
        position = np.stack(
            [
                np.column_stack([np.interp(time, table[:, 0], table[:, k]) for k in (1, 2, 3)])
                for table in tables
            ],
            axis=1,
        )
        last = [np.searchsorted(table[:, 0], time, side="right") - 1 for table in tables]
        yaw, air = (
            np.column_stack([table[at, k] for table, at in zip(tables, last, strict=True)])
            for k in (4, 5)
        )
        return time, position, yaw, air > 0
