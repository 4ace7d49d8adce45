"""One agent: odometry between images, tags in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest

from star_apriltag.agent_estimator import ADVANCE_DELAY, ADVANCE_PERIOD, FilterEstimator
from star_apriltag.dead_reckoning import AgentState
from star_core import Odometry, Pose, Tag
from star_core.toolkit import rotation_from_vector
from star_sim.camera_sim.ground_truth import real_tags
from star_sim.camera_sim.options import camera_options
from tests.plugins.localizers.apriltag.conftest import (
    HEIGHT,
    RATE,
    SETTINGS,
    SPEED,
    TICK,
    Circle,
    sheets,
    views,
)

TAGS = sheets(8)
LATENCY = 0.15  # s


@cache
def displaced(tags: tuple[Tag, ...], survey: float, seed: int) -> list[Tag]:
    """Return the real tags for those of a map whose positions err by `survey`, m and rad."""
    error = camera_options(survey_std=survey, survey_yaw_std_deg=math.degrees(survey))
    return list(real_tags(tags, [seed, 1], error))


class Flight:
    """A tracker that hears odometry in each tick and sees every second one's tags."""

    def __init__(
        self, circle: Circle, *, noise: float = 0.0, survey: float = 0.0, seed: int = 0
    ) -> None:
        settings = SETTINGS._replace(
            mounting_std=math.radians(1.0), survey_std=survey, survey_turn_std=survey
        )
        self.estimator = FilterEstimator(circle.agent(), tuple(TAGS), (), settings)
        self.circle = circle
        self.now = 0.0
        self._noise = noise
        self._survey = survey
        self._seed = seed
        self._rng = np.random.default_rng(seed)

    def hear(self, until: float) -> None:
        stream = self.circle.odometry(self.now, until)
        self.estimator.track.add(stream, np.arange(len(stream.agent)))
        self.now = until

    def see(self, taken: float, tags: Sequence[Tag] = TAGS) -> None:
        real = displaced(tuple(tags), self._survey, self._seed) if self._survey else tags
        measured = [
            (tag, view._replace(rays=view.rays + self._noise / 180 * self._rng.normal(size=(4, 2))))
            for tag, view in views(self.circle.body(taken), tags, real)
        ]
        if measured:
            self.estimator.add_views(taken, measured)

    def fly(self, seconds: float, tags: Sequence[Tag] = TAGS) -> list[AgentState]:
        beliefs = []
        for k in range(round(seconds / TICK)):
            self.hear(round(self.now + TICK, 9))
            if k % 2 == 0 and self.now > LATENCY:
                self.see(self.now - LATENCY, tags)
            self.estimator.advance(self.now)
            beliefs.append(self.estimator.at(self.now))
        return beliefs

    def stand(self, seconds: float, yaw_rate: float) -> None:
        """Stop dead, and have the motors off for a while."""
        for _ in range(round(seconds)):
            time = self.now + np.linspace(0.01, 1.0, 100)
            n, zero = len(time), np.zeros(100)
            turns = np.full(n, yaw_rate)
            still = Odometry(np.zeros(n, int), time, np.zeros((n, 3)), turns, zero, zero, zero)
            self.estimator.track.add(still, np.arange(n), motors=False)
            self.now += 1.0
            self.estimator.advance(self.now)

    def nees(self, belief: AgentState, time: float) -> float:
        """Squared error in x and y over covariance, a degree of freedom."""
        error = (belief.position - self.circle.body(time).position)[:2]
        return float(error @ np.linalg.solve(belief.covariance[:2, :2], error)) / 2


def test_exact_odometry_is_carried_on_exactly() -> None:
    (*_, last) = Flight(circle := Circle(10)).fly(10.0, tags=())
    body = circle.body(10.0)
    assert last.position == pytest.approx(body.position, abs=1e-4)
    assert math.remainder(last.yaw - body.yaw, math.tau) == pytest.approx(0, abs=1e-6)


def test_velocity_and_yaw_rate_are_those_of_now() -> None:
    (*_, last) = Flight(circle := Circle(10)).fly(10.0, tags=())
    assert last.velocity == pytest.approx(SPEED * circle.body(10.0).rotation[:, 0], abs=1e-4)
    assert last.yaw_rate == pytest.approx(RATE)


def test_tags_hold_the_position_though_odometry_drifts() -> None:
    scale = complex(1.08, 0.05)
    circle = Circle(14, scale=scale)
    blind, seeing = (Flight(circle).fly(14.0, tags=tags)[-1] for tags in ((), TAGS))
    body = circle.body(14.0)
    far = [np.linalg.norm(belief.position - body.position) for belief in (seeing, blind)]
    assert far[0] < 0.01
    assert far[1] > 10 * far[0]
    assert seeing.velocity == pytest.approx(SPEED * body.rotation[:, 0], abs=0.03 * SPEED)


def test_the_chain_is_whole_over_ten_seconds_without_a_tag() -> None:
    flight = Flight(Circle(20))
    flight.fly(3.0)
    flight.hear(13.0)
    flight.estimator.advance(13.0)
    assert 0 <= 13.0 - LATENCY - ADVANCE_DELAY - flight.estimator.anchor.time <= ADVANCE_PERIOD
    flight.see(13.0 - LATENCY)
    body = flight.circle.body(13.0)
    assert flight.estimator.at(13.0).position == pytest.approx(body.position, abs=0.01)


def test_one_leg_over_ten_seconds_is_survived_too() -> None:
    flight = Flight(Circle(20))
    flight.fly(3.0)
    flight.hear(13.0)
    flight.see(13.0)
    assert flight.estimator.at(13.0).position == pytest.approx(
        flight.circle.body(13.0).position, abs=0.01
    )


def test_standing_changes_nothing_despite_a_learnt_gyro_bias() -> None:
    bias = math.radians(0.4)
    flight = Flight(Circle(20, yaw_bias=bias))
    (*_, landed) = flight.fly(20.0)
    assert flight.estimator.anchor.yaw_bias == pytest.approx(bias, rel=0.3)
    for bias_on_the_ground in (0.0, bias):
        flight.stand(120.0, bias_on_the_ground)
        belief = flight.estimator.at(flight.now)
        assert belief.position == pytest.approx(landed.position, abs=1e-3)
        assert belief.yaw == pytest.approx(landed.yaw, abs=math.radians(0.1))
        assert belief.covariance[3, 3] < 1.05 * landed.covariance[3, 3]


@pytest.mark.parametrize("late", [0.0, 0.3, 5.0])
def test_an_image_no_later_than_the_newest_node_is_ignored(late: float) -> None:
    flight = Flight(Circle(10))
    flight.fly(4.0)
    node = flight.estimator.anchor
    late_views = views(flight.circle.body(0.5), TAGS)
    flight.estimator.add_views(node.time - late, late_views)
    assert flight.estimator.anchor is node


def test_covariance_grows_along_odometry() -> None:
    flight = Flight(Circle(20))
    flight.fly(5.0)
    begin = flight.estimator.anchor.time
    flight.hear(15.0)
    spread = [flight.estimator.at(begin + k).covariance for k in range(10)]
    for k in range(9):
        assert (np.linalg.eigvalsh(spread[k + 1] - spread[k])[-1]) > 0
    traces = [np.trace(covariance[:2, :2]) for covariance in spread]
    assert (np.diff(traces) > 0).all()
    assert (np.diff([covariance[3, 3] for covariance in spread]) > 0).all()


def test_covariance_is_one_whether_the_way_is_one_leg_or_many() -> None:
    whole, parts = Flight(Circle(10)), Flight(Circle(10))
    for flight in (whole, parts):
        flight.hear(6.0)
    parts.estimator.advance(6.5 - 1e-9)
    whole_std = np.sqrt(np.diag(whole.estimator.at(6.0).covariance))
    parts_std = np.sqrt(np.diag(parts.estimator.at(6.0).covariance))
    assert parts_std[[0, 1, 3]] == pytest.approx(whole_std[[0, 1, 3]], rel=0.3)


@pytest.mark.extended
def test_its_covariance_is_honest_over_many_flights() -> None:
    surprises = []
    for seed in range(6):
        flight = Flight(Circle(12, seed=seed), noise=0.3, survey=0.008, seed=seed)
        beliefs = flight.fly(12.0, sheets(2))
        surprises += [flight.nees(beliefs[k], (k + 1) * TICK) for k in range(40, len(beliefs))]
    assert 0.15 < np.mean(surprises) < 2.0


def test_after_a_restart_the_state_is_the_given_pose() -> None:
    flight = Flight(Circle(10))
    flight.fly(4.0)
    pose = Pose(rotation_from_vector(np.array([0.0, 0.0, 1.0])), np.array([5.0, 5.0, HEIGHT]))
    flight.estimator.restart(4.0, pose, np.eye(6) * 1e-4)
    assert flight.estimator.at(4.0).position == pytest.approx([5.0, 5.0, HEIGHT])
    assert flight.estimator.at(4.0).yaw == pytest.approx(1.0)
