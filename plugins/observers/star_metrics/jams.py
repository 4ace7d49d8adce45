"""Jams: swarms of which most agents stand although their goals are far."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import numpy as np

from star_core import AgentPhase, Array, Rows, Scene, Tick
from star_core.toolkit import Pairs, every, position_margin

PERIOD: Final = 1.0  # s, between two samples: noise of velocities averages out
WINDOW: Final = 10.0  # s, over which speeds are averaged
SAMPLES: Final = round(WINDOW / PERIOD) + 1
STANDING_SPEED: Final = 0.1  # m/s, mean over the ground, below which an agent stands
FAR: Final = 0.3  # m from the goal
MIN_SHARE: Final = 0.5  # of the agents with far goals, above which it is a jam
NEAR: Final = 1.8  # m, between two agents that brake for each other at 0.5 m/s
NARROW: Final = 0.5  # share of the separation from which on margins are the cause


class Jams:
    """Counts jams: more than half of the agents with far goals stand.

    Considered are agents that have been flying to goals farther than `FAR` for `WINDOW`, at least
    two of them. An agent stands whose mean speed over the ground in that time is less than
    `STANDING_SPEED`. A jam is over when it does not hold any more.

    Attributes:
        count: Number of jams so far.
    """

    def __init__(self, scene: Scene) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._time = 0.0  # s
        self._flown = np.zeros((n, 2))  # m, so far by the velocities: positions may be corrected
        self._samples: deque[Array] = deque(maxlen=SAMPLES)
        self._far_since = np.full(n, np.inf)  # s
        self._jammed = False
        self._due = -np.inf  # s, time of the next sample
        self.count = 0

    def add(self, tick: Tick) -> tuple[str, dict[str, Any]] | None:
        """Return text and details of the event of a jam that begins at a tick."""
        velocity = tick.estimate.velocity
        if not every(np.isfinite(velocity)):
            velocity = np.nan_to_num(velocity)
        self._flown = self._flown + (tick.time - self._time) * velocity[:, :2]
        self._time = tick.time
        if tick.time < self._due:
            return None
        self._due = tick.time + PERIOD
        position = tick.estimate.position
        flies = tick.goals.active & (tick.health.phase == int(AgentPhase.FLYING))
        far = flies & (np.linalg.norm(tick.goals.position - position, axis=1) > FAR)
        self._far_since = np.where(far, np.minimum(self._far_since, tick.time), np.inf)
        self._samples.append(self._flown)
        if len(self._samples) < SAMPLES:
            return None
        steps = np.diff(np.array(self._samples), axis=0)
        speed = np.linalg.norm(steps, axis=2).sum(axis=0) / WINDOW
        considered = self._far_since <= tick.time - WINDOW
        standing = considered & (speed < STANDING_SPEED)
        number = int(considered.sum())
        jammed = number > 1 and standing.sum() > MIN_SHARE * number
        begins, self._jammed = jammed and not self._jammed, bool(jammed)
        if not begins:
            return None
        self.count += 1
        return self._described(tick, np.flatnonzero(standing), number)

    def _described(self, tick: Tick, rows: Rows, number: int) -> tuple[str, dict[str, Any]]:
        near = Pairs.of(tick.estimate.position, NEAR)
        limits, names = self._scene.limits, self._scene.names
        standing = f"{len(rows)} of {number} agents with far goals have stood for {WINDOW:g} s"
        details: dict[str, Any] = {"agents": [names[row] for row in rows], "time_s": tick.time}
        between = np.isin(near.first, rows) & np.isin(near.second, rows)
        deviations = position_margin(tick.estimate.covariance, 1.0, np.inf)
        alone = float(np.median(deviations[rows]))
        clearance = limits.uncertainty_margin * alone
        if not between.any():
            cause, text = "unknown", "no two of them are near each other"
            if clearance > NARROW * limits.separation:
                cause = "uncertainty_margin"
                details |= {"position_std_m": alone, "margin_m": clearance}
                text += (
                    f", and limits.uncertainty_margin adds up to {clearance:.2f} m to "
                    "the clearance from obstacles and fence, since positions have a deviation of "
                    f"{alone:.2f} m"
                )
        else:
            first, second = near.first[between], near.second[between]
            apart = float(np.median(near.distance[between]))
            std = float(np.median(np.concatenate([deviations[first], deviations[second]])))
            margin = 2 * limits.uncertainty_margin * std
            details |= {"distance_m": apart, "position_std_m": std, "margin_m": margin}
            where = f"those near each other are {apart:.2f} m apart"
            if margin > NARROW * limits.separation:
                cause = "uncertainty_margin"
                text = (
                    f"{where}, and limits.uncertainty_margin adds up to {margin:.2f} m to the "
                    f"distances to keep, since positions have a standard deviation of {std:.2f} m"
                )
            else:
                cause = "separation"
                text = f"{where}: limits.separation and the avoider's distances leave no way"
        details["cause"] = cause
        names_of = self._scene.named(rows.tolist())
        return f"jam: {standing}: {names_of}; {text}", details
