"""The fixed-lag smoother: what it finds, how sure it is, and how it is begun anew."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import gtsam
import numpy as np
import pytest

from star_apriltag.smoother import Leg, Smoother
from star_apriltag.vision.body_pose import AT_REST, View
from star_core import Array, Pose, Tag, rotation_from_vector
from tests.plugins.localizers.apriltag.conftest import LENS, Circle, sheets, views

EVERY = 0.1  # s
TAGS = sheets(8)
DEVIATIONS = np.array([0.002, 0.002, 0.003, 0.005, 0.005, 0.003])
LEVEL = gtsam.Rot3()
START = np.diag(np.array([0.05, 0.05, 0.1, 0.3, 0.3, 0.02]) ** 2)


def of(body: Pose) -> gtsam.Pose3:
    return gtsam.Pose3(gtsam.Rot3(body.rotation), body.position)


class Flight:
    """A smoother with the measurements of an exact flight."""

    def __init__(self, start: Pose, *, mounting_std: float = math.radians(1.0)) -> None:
        self.circle = Circle(1.0)
        self.smoother = Smoother(LENS.mounting, mounting_std=mounting_std, lag=2.5)
        self.smoother.start(0.0, of(start), START)
        self.steps = 0

    def go(self, seen: Sequence[View] = (), *, drift: Array | None = None) -> None:
        """Go on by one leg."""
        self.steps += 1
        before, now = self.circle.body(self.time - EVERY), self.circle.body(self.time)
        delta = of(before).between(of(now))
        if drift is not None:
            delta = delta.compose(gtsam.Pose3.Expmap(drift))
        leg = Leg(delta, DEVIATIONS)
        self.smoother.add(self.time, leg, LEVEL, float(now.position[2]), seen, AT_REST)

    def fly(self, steps: int, tags: Sequence[Tag] = TAGS) -> None:
        for _ in range(steps):
            self.go(self.seen(tags))

    def seen(self, tags: Sequence[Tag] = TAGS) -> list[View]:
        """What is seen at the next step."""
        return views(self.circle.body(self.time + EVERY), tags)

    @property
    def time(self) -> float:
        return self.steps * EVERY

    @property
    def off(self) -> float:
        """How far it is from the truth, m."""
        there = self.smoother.node.pose.translation() - self.circle.body(self.time).position
        return float(np.linalg.norm(there))

    @property
    def spread(self) -> float:
        """Deviation of the place along its worst direction, m."""
        covariance = self.smoother.node.covariance[3:, 3:]
        return math.sqrt(np.linalg.eigvalsh(covariance)[-1])


def right(**how: float) -> Flight:
    return Flight(Circle(1.0).body(0.0), **how)


def wrong() -> Flight:
    body = Circle(1.0).body(0.0)
    return Flight(
        Pose(
            body.rotation @ rotation_from_vector(np.array([0, 0, 0.15])),
            body.position + np.array([0.4, -0.3, 0]),
        )
    )


def broken() -> View:
    return View(np.full((4, 3), math.nan), np.zeros((4, 2)), 0.002, np.zeros(4))


def test_it_comes_to_the_truth_from_a_wrong_start() -> None:
    flight = wrong()
    flight.fly(60)
    assert flight.off < 0.02


def test_it_stays_on_the_truth() -> None:
    flight = right()
    flight.fly(60)
    assert flight.off < 1e-3


def points(seen: Sequence[View]) -> list[View]:
    """Of each tag the first corner alone, as guided matching finds a single point."""
    return [View(v.points[:1], v.rays[:1], v.deviation, v.delay[:1]) for v in seen]


def test_single_points_keep_it_on_the_truth() -> None:
    pointed, without = right(), right()
    drift = np.array([0.0, 0.0, 0.002, 0.004, 0.0, 0.0])
    for _ in range(80):
        pointed.go(points(pointed.seen()), drift=drift)
        without.go(drift=drift)
    assert pointed.off < 0.1 * without.off


def test_points_that_are_wrong_do_little_harm_among_right_tags() -> None:
    flight = right()
    for _ in range(40):
        seen = flight.seen()
        wrong = [v._replace(rays=v.rays + 0.05) for v in points(seen)[:1]]  # about 9 px
        flight.go([*seen, *wrong])
    assert flight.off < 0.02
    assert flight.smoother.restarts == 0


def test_it_mends_odometry_that_drifts() -> None:
    with_tags, without = right(), right()
    drift = np.array([0.0, 0.0, 0.002, 0.004, 0.0, 0.0])
    for _ in range(80):
        with_tags.go(with_tags.seen(), drift=drift)
        without.go(drift=drift)
    assert with_tags.off < 0.25 * without.off


def test_it_grows_surer_by_tags_and_less_sure_without() -> None:
    flight = right()
    flight.go()
    before = flight.spread
    flight.fly(40)
    seen = flight.spread
    flight.fly(40, tags=())
    assert seen < 0.2 * before
    assert flight.spread > 1.5 * seen


def test_without_tags_the_deviation_only_grows() -> None:
    flight = right()
    spreads = []
    for _ in range(40):
        flight.go()
        spreads.append(flight.spread)
    assert (np.diff(spreads) > 0).all()


def test_it_learns_how_the_camera_is_turned() -> None:
    extra = rotation_from_vector(np.radians([1.0, -0.7, 0.5]))
    flight = right(mounting_std=math.radians(2.0))
    mounting = LENS.mounting
    real = mounting._replace(rotation=mounting.rotation @ extra.T)
    for _ in range(200):
        body = flight.circle.body(flight.time + EVERY)
        seen = []
        for view in views(body, TAGS):
            there = (body @ real).inverse().apply(view.points)
            seen.append(view._replace(rays=there[:, :2] / there[:, 2:]))
        flight.go(seen)
    left = flight.smoother.camera_turn @ extra.T
    assert math.acos(min(1.0, (np.trace(left) - 1) / 2)) < math.radians(0.3)


def test_a_correct_mounting_is_not_changed() -> None:
    flight = right()
    flight.fly(50)
    assert np.abs(flight.smoother.camera_turn - np.eye(3)).max() < 1e-4


def test_the_graph_does_not_grow() -> None:
    flight = right()
    flight.fly(100)
    before = flight.smoother._isam.getFactors().size()
    flight.fly(300)
    assert flight.smoother._isam.getFactors().size() < 1.5 * before
    assert flight.smoother._isam.calculateEstimate().size() < 2.5 / EVERY + 4


def poison_by_nan(flight: Flight) -> None:
    flight.go([broken()])


def poison_by_a_key_that_is_there(flight: Flight) -> None:
    flight.smoother._count -= 1
    flight.go()


def poison_by_a_key_that_has_expired(flight: Flight) -> None:
    flight.smoother._count -= 35
    flight.go()


@pytest.mark.parametrize(
    "poison",
    [poison_by_nan, poison_by_a_key_that_is_there, poison_by_a_key_that_has_expired],
)
def test_a_poisoned_graph_is_begun_anew_and_goes_on(poison: Callable[[Flight], None]) -> None:
    flight = right()
    flight.fly(40)
    poison(flight)
    assert flight.smoother.restarts == 1
    assert flight.smoother.node.time == flight.time
    for _ in range(40):
        flight.go(flight.seen())
        assert np.isfinite(flight.smoother.node.pose.matrix()).all()
        assert np.isfinite(flight.smoother.node.covariance).all()
        assert flight.off < 0.01
    assert flight.smoother.restarts == 1


def test_poison_again_and_again_is_survived() -> None:
    flight = right()
    flight.fly(10)
    for _ in range(20):
        flight.go([broken()])
        flight.go(flight.seen())
    assert flight.smoother.restarts == 20
    assert flight.off < 0.02


def test_begun_anew_it_is_no_surer_than_before() -> None:
    flight = right()
    flight.fly(40)
    before = flight.spread
    poison_by_nan(flight)
    assert before < flight.spread < 3 * before


def test_what_was_learnt_of_the_camera_outlives_the_graph() -> None:
    flight = right(mounting_std=math.radians(2.0))
    flight.fly(40)
    flight.smoother._turn = gtsam.Rot3(rotation_from_vector(np.array([0.01, 0, 0])))
    poison_by_nan(flight)
    assert flight.smoother.camera_turn == pytest.approx(
        rotation_from_vector(np.array([0.01, 0, 0]))
    )


def test_started_elsewhere_it_is_there() -> None:
    flight = right()
    flight.fly(20)
    elsewhere = gtsam.Pose3(gtsam.Rot3.Yaw(0.3), np.array([3.0, 1.0, 0.8]))
    flight.smoother.start(flight.time, elsewhere, START)
    flight.go()
    assert np.linalg.norm(flight.smoother.node.pose.translation() - [3, 1, 0.8]) < 0.1
    assert flight.smoother.restarts == 0
