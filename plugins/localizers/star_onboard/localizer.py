"""Positions as the on-board estimators report them, in the map frame."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core import Estimate, Mask, Scene, Telemetry, Transform
from star_core.toolkit import SurfaceHeights, freeze, shortlist, some
from star_onboard.systems import system_std

MAX_STD: Final = 0.1  # m, default of `max_std` with a Flow deck, and
INERTIAL_MAX_STD: Final = 0.25  # m, without
FIRST_TIME: Final = 1.0  # s of the mission, in which estimators converge


class Onboard:
    """Takes the reports of on-board estimators that know the map.

    A row is valid while its report is finite, no older than `max_report_age`, and its estimator
    reports standard deviations of at most `max_std`; so no agent takes off before its receiver
    works, and one that leaves the coverage is not located after some seconds. A row that is not
    valid keeps its last position, at rest. Reports without variances are taken as they are. Heights
    of Flow decks are those of rangers, and corrected over obstacles of the map.

    Args:
        scene: Agents.
        system: Its name.
        std: Of its errors along x and along y, m; None takes that of `system_std`.
        height_std: The same along z.
        max_std: Greatest standard deviation that an estimator may report, m; None is `MAX_STD`, or
            `INERTIAL_MAX_STD` without Flow decks.
        max_report_age: Age up to which a report is valid, s.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        system: str,
        std: float | None,
        height_std: float | None,
        max_std: float | None,
        max_report_age: float,
    ) -> None:
        n = len(scene.agents)
        self._scene = scene
        if max_std is None:
            max_std = MAX_STD if scene.flow_deck else INERTIAL_MAX_STD
        self._max_variance, self._max_report_age = max_std**2, max_report_age
        planar, vertical = system_std(scene, system)
        planar = planar if std is None else std
        vertical = vertical if height_std is None else height_std
        self._variance = np.diag(np.square([planar, planar, vertical]))
        self._map_from_odom = Transform(np.zeros(n), np.zeros((n, 3)))
        self._surfaces = SurfaceHeights(scene, only_mapped=True)
        self._offset = np.zeros(n)  # m, added to heights
        self._position = np.array([agent.start for agent in scene.agents], float).reshape(n, 3)
        self._yaw = np.array([agent.yaw for agent in scene.agents], float)
        self._covariance = np.tile(self._variance, (n, 1, 1))
        self._lost = np.zeros(n, np.bool_)
        self._messages: list[str] = []

    def locate(self, telemetry: Telemetry) -> Estimate:
        below = self._surfaces.correct(telemetry, self._position, self._covariance)
        if some(below.offset != self._offset):
            self._offset = below.offset
            translation = np.zeros_like(self._position)
            translation[:, 2] = below.offset
            self._map_from_odom = Transform(self._map_from_odom.yaw, translation)
        position, velocity = below.telemetry.position, below.telemetry.velocity
        yaw = telemetry.heading
        finite = np.isfinite(position.sum(axis=1) + velocity.sum(axis=1) + yaw)
        covariance = np.tile(self._variance, (len(yaw), 1, 1))
        converged = finite
        if (variance := telemetry.position_variance) is not None:
            converged = finite & (variance <= self._max_variance).all(axis=1)
            covariance[:, range(3), range(3)] += np.where(converged[:, None], variance, 0.0)
        covariance[:, 2, 2] += below.variance
        self._covariance = covariance
        self._position = np.where(converged[:, None], position, self._position)
        self._yaw = np.where(converged, yaw, self._yaw)
        self._note(telemetry, converged)
        velocity = np.where(converged[:, None], velocity, 0.0)
        valid = converged & (telemetry.age <= self._max_report_age)
        freeze(self._position, velocity, self._yaw, covariance, valid)
        return Estimate(
            time=telemetry.time,
            position=self._position,
            velocity=velocity,
            yaw=self._yaw,
            covariance=covariance,
            valid=valid,
            map_from_odom=self._map_from_odom,
            messages=self._reported(),
            heights=below.heights,
        )

    def _note(self, telemetry: Telemetry, converged: Mask) -> None:
        """Report agents whose estimators do not know where they are, and those that do again."""
        lost = ~converged & (telemetry.time > FIRST_TIME)
        names = self._scene.names
        if news := [names[row] for row in np.flatnonzero(lost & ~self._lost).tolist()]:
            self._messages.append(f"estimators do not know the positions of {shortlist(news)}")
        if news := [names[row] for row in np.flatnonzero(self._lost & converged).tolist()]:
            self._messages.append(f"estimators know the positions of {shortlist(news)} again")
        self._lost = lost

    def _reported(self) -> tuple[str, ...]:
        messages, self._messages = tuple(self._messages), []
        return messages
