"""Follows several agents: what they hear and see in one tick, and what is learnt from it."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import gtsam
import numpy as np

from star_apriltag.agent_estimator import Follower, Settings, Sight, Smoothed
from star_apriltag.batch import Batched
from star_apriltag.dead_reckoning import Belief, Known
from star_apriltag.vision.tag_measurement import Look
from star_core import Mask, Odometry, Scene, Sightings, Tag

log = logging.getLogger(__name__)


class Heard(NamedTuple):
    """What some agents report in one tick.

    Attributes:
        time: Of the tick, s.
        odometry: Since the last tick.
        sights: In the order in which they were taken.
        motors: (N,) which agents' motors may run.
    """

    time: float
    odometry: Odometry
    sights: tuple[Sight, ...]
    motors: Mask

    def of(self, rows: Sequence[int]) -> Heard:
        """Return what the agents in `rows` report."""
        mine = np.isin(self.odometry.agent, rows)
        names = Odometry.__dataclass_fields__
        return Heard(
            self.time,
            Odometry(**{name: getattr(self.odometry, name)[mine] for name in names}),
            tuple(sight for sight in self.sights if sight.row in rows),
            self.motors,
        )


class Learnt(NamedTuple):
    """What has been learnt from that.

    Attributes:
        known: Of those agents of whom something new is known, by their rows.
        fixed: Rows of the agents with an accepted landmark sighting.
        sightings: Targets seen, an item an image.
    """

    known: dict[int, Known]
    fixed: frozenset[int]
    sightings: tuple[Sightings, ...]


NOTHING = Learnt({}, frozenset(), ())


def together(learnt: Iterable[Learnt]) -> Learnt:
    """Return what has been learnt from several ticks, earlier ones first, or by several groups."""
    known: dict[int, Known] = {}
    fixed: frozenset[int] = frozenset()
    sightings: tuple[Sightings, ...] = ()
    for one in learnt:
        known |= one.known
        fixed |= one.fixed
        sightings += one.sightings
    return Learnt(known, fixed, sightings)


class Group:
    """The followers of some agents.

    Args:
        scene: Agents with their cameras, the map.
        rows: Which agents to follow.
        settings: How.
    """

    def __init__(self, scene: Scene, rows: Iterable[int], settings: Settings) -> None:
        landmarks = _first_of_each(scene.world.landmarks, settings.max_tags_per_landmark)
        self._scene = scene
        self._followers: dict[int, Follower] = {
            row: Batched(scene.agents[row], landmarks)
            if settings.method == "batch"
            else Smoothed(scene.agents[row], landmarks, scene.world.targets, settings)
            for row in rows
        }

    def follow(self, heard: Heard) -> Learnt:
        """Return what a tick says that was not known before it."""
        before = {row: follower.known.node for row, follower in self._followers.items()}
        for row, follower in self._followers.items():
            rows = np.flatnonzero(heard.odometry.agent == row)
            follower.hear(heard.odometry, rows, motors=bool(heard.motors[row]))
        fixed: set[int] = set()
        sightings: list[Sightings] = []
        for sight in heard.sights:
            try:
                looked = self._followers[sight.row].look(sight)
            except ValueError as error:
                name = self._scene.agents[sight.row].name
                log.warning("an image of %s is passed over: %s", name, error)
                continue
            if looked is not None:
                look, belief = looked
                sightings += _sightings(sight, look, belief)
                fixed |= {sight.row} if look.views else set()
        for follower in self._followers.values():
            follower.go_on(heard.time)
        known = {row: follower.known for row, follower in self._followers.items()}
        return Learnt(
            {row: one for row, one in known.items() if one.node is not before[row]},
            frozenset(fixed),
            tuple(sightings),
        )


def _first_of_each(tags: tuple[Tag, ...], most: int) -> tuple[Tag, ...]:
    """The first few tags of each landmark."""
    used: dict[str, int] = {}
    kept = []
    for tag in tags:
        used[tag.of] = used.get(tag.of, 0) + 1
        if used[tag.of] <= most:
            kept.append(tag)
    return tuple(kept)


def _sightings(sight: Sight, look: Look, belief: Belief) -> list[Sightings]:
    """Targets seen in one image, in the map."""
    rotation = gtsam.Rot3.Ypr(belief.yaw, belief.pitch, belief.roll).matrix()
    seen = []
    for target in look.targets:
        away = rotation @ target.pose.position
        turning = np.array([-away[1], away[0], 0.0])
        covariance = rotation @ target.covariance @ rotation.T + belief.covariance[:3, :3]
        cross = np.outer(belief.covariance[:3, 3], turning)
        covariance += cross + cross.T + belief.covariance[3, 3] * np.outer(turning, turning)
        ahead = rotation @ target.pose.rotation[:, 0]
        seen.append(
            Sightings(
                agent=np.array([sight.row]),
                tag=np.array([target.tag]),
                time=np.array([sight.taken]),
                position=(belief.position + away)[None],
                yaw=np.array([math.atan2(ahead[1], ahead[0])]),
                covariance=covariance[None],
            )
        )
    return seen
