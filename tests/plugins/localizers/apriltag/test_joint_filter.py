"""The filter of the state with errors that last: derivatives, what it learns, how sure it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from star_apriltag.dead_reckoning import (
    FLOOR,
    SCALE,
    SLIP_X,
    SLIP_Y,
    STATES,
    TURN,
    YAW,
    YAW_BIAS,
    Anchor,
    X,
    Z,
    body_velocity,
    carried,
    predict,
    start,
)
from star_apriltag.joint_filter import CAMERA, FOCAL, LANDMARK, Deviations, JointFilter
from star_apriltag.odometry_track import OdometryTrack
from star_apriltag.vision.body_pose import View
from star_core import Array, Odometry, Pose, Tag
from star_core.toolkit import rotation_from_vector
from tests.plugins.localizers.apriltag.conftest import HEIGHT, LENS, SPEED, Circle, sheets, views

EVERY = 0.1  # s
TAGS = sheets(8)
CAREFUL = Deviations(mounting=math.radians(1.0), survey=0.005, survey_turn=0.01, latency=0.02)
STEP = 1e-6


def odometry(circle: Circle, height: float = 0.0) -> OdometryTrack:
    track = OdometryTrack()
    stream = circle.odometry(0.0, np.inf)
    object.__setattr__(stream, "height", np.full(len(stream.time), height))
    track.add(stream, np.arange(len(stream.agent)))
    return track


class Flight:
    """A filter of a flight around the circle."""

    def __init__(
        self,
        circle: Circle,
        *,
        deviations: Deviations = CAREFUL,
        real: Sequence[Tag] = TAGS,
        camera: Pose = LENS.mounting,
        height: float = 0.0,
    ) -> None:
        self.circle, self.track = circle, odometry(circle, height)
        self._real, self._camera = real, camera
        self.filter = JointFilter(start(circle.agent()), LENS.mounting, TAGS, HEIGHT, deviations)
        self.time = 0.0

    def views_at(self, time: float) -> list[tuple[int, View]]:
        """The tags in an image, through the real camera."""
        body, measured = self.circle.body(time), []
        real = {tag.id: tag for tag in self._real}
        for number, view in views(body, TAGS):
            in_sight = views(body, [real[number]])
            if in_sight:
                points = (body @ self._camera).inverse().apply(in_sight[0][1].points)
                measured.append((number, view._replace(rays=points[:, :2] / points[:, 2:])))
        return measured

    def fly(self, seconds: float, *, blind: bool = False) -> None:
        for _ in range(round(seconds / EVERY)):
            self.time += EVERY
            self.filter.advance(self.time, self.track)
            if not blind and (measured := self.views_at(self.time)):
                self.filter.update(measured, self.track, stamped=True)

    @property
    def off(self) -> Array:
        """(3,) error of the position, m."""
        x, y, z, _ = self.filter.anchor.mean[: YAW + 1]
        height = HEIGHT + self.track.at(self.time).height
        error: Array = np.array([x, y, height + z]) - self.circle.body(self.time).position
        return error

    @property
    def spread(self) -> float:
        """Standard deviation of the position in its worst direction, m."""
        return math.sqrt(np.linalg.eigvalsh(self.filter.anchor.covariance[:2, :2])[-1])


numbers = st.lists(st.floats(-1.0, 1.0), min_size=60, max_size=60).map(np.array)


@settings(max_examples=5)
@given(numbers, st.floats(0.01, 3.0))
def test_the_derivative_of_dead_reckoning_is_that_of_differences(
    off: Array, seconds: float
) -> None:
    track = odometry(Circle(5.0))
    begin = start(Circle(5.0).agent())
    begin = begin._replace(mean=begin.mean + 0.05 * off[:STATES])
    ended, moved = carried(begin, seconds, track)
    assert np.linalg.eigvalsh(ended.covariance).min() > -1e-9
    for k in range(STATES):
        if k == FLOOR:  # the distance over which it changes is that of the odometry itself
            continue
        step = STEP * np.eye(STATES)[k]
        ahead, back = (
            carried(begin._replace(mean=begin.mean + offset), seconds, track)[0].mean
            for offset in (step, -step)
        )
        slope = (ahead - back) / (2 * STEP)
        slope[FLOOR] = moved[FLOOR, k]
        close = 0.03 if k in {SCALE, TURN, YAW_BIAS} else 1e-5
        assert moved[:, k] == pytest.approx(slope, abs=close * max(seconds, 1.0))


@settings(max_examples=5)
@given(numbers)
def test_the_derivatives_of_an_image_are_those_of_differences(off: Array) -> None:
    flight = Flight(Circle(5.0))
    flight.fly(1.0)
    made, measured = flight.filter, flight.views_at(flight.time)
    rows = [made._landmark_row(tag) for tag, _ in measured]
    made._mean = made._mean + 0.02 * off[: len(made._mean)]
    made._mean[CAMERA] = 0.0
    _, by_state, _ = made._residuals(measured, rows, flight.track)
    mean, turn = made._mean, made.camera_turn
    skipped = {SCALE, TURN, FLOOR, YAW_BIAS}  # they only move the rows of a rolling shutter
    for k in set(range(FOCAL + 1)) - skipped | {rows[0] + j for j in range(LANDMARK)}:
        ends = []
        for step in (STEP, -STEP):
            made._mean = mean + step * np.eye(len(mean))[k]
            made.camera_turn = turn @ rotation_from_vector(made._mean[CAMERA])
            ends.append(made._residuals(measured, rows, flight.track)[0])
        assert by_state[:, k] == pytest.approx((ends[0] - ends[1]) / (2 * STEP), abs=0.02)


def test_it_stays_on_the_truth_and_changes_no_calibration() -> None:
    flight = Flight(Circle(10))
    flight.fly(10.0)
    assert np.abs(flight.off).max() < 1e-3
    assert np.abs(flight.filter.camera_turn - np.eye(3)).max() < 1e-3
    assert abs(flight.filter.anchor.factor - 1) < 1e-3


def test_uncertainty_grows_without_tags_and_shrinks_with_them() -> None:
    flight = Flight(Circle(20))
    flight.fly(5.0)
    spreads = [flight.spread]
    for _ in range(5):
        flight.fly(1.0, blind=True)
        spreads.append(flight.spread)
    assert (np.diff(spreads) > 0).all()
    flight.fly(3.0)
    assert flight.spread < 0.5 * spreads[-1]


def test_it_learns_scale_and_misalignment_and_yaw_bias() -> None:
    scale, bias = 1.06 * complex(math.cos(0.03), math.sin(0.03)), math.radians(0.3)
    flight = Flight(Circle(25, scale=scale, yaw_bias=bias))
    flight.fly(25.0)
    velocity = body_velocity(flight.filter.anchor, flight.track.at(25.0))
    assert velocity == pytest.approx(SPEED, abs=0.02 * SPEED)
    assert flight.filter.anchor.yaw_bias == pytest.approx(bias, rel=0.2)


def test_the_yaw_rate_is_the_derivative_of_the_yaw() -> None:
    circle = Circle(20)
    anchor = start(circle.agent())
    anchor.mean[YAW_BIAS] = 0.05  # rad/s
    now, later = (predict(anchor, time, odometry(circle), HEIGHT) for time in (10.0, 10.5))
    turned = math.remainder(later.yaw - now.yaw, 2 * math.pi)
    assert now.yaw_rate == pytest.approx(turned / 0.5, abs=1e-3)


def test_it_learns_how_the_camera_is_turned() -> None:
    extra = rotation_from_vector(np.radians([1.0, -0.7, 0.5]))
    mounting = LENS.mounting
    real = mounting._replace(rotation=mounting.rotation @ extra.T)
    flight = Flight(Circle(14), camera=real)
    flight.fly(14.0)
    left = flight.filter.camera_turn @ extra.T
    assert math.acos(min(1.0, (np.trace(left) - 1) / 2)) < math.radians(0.5)
    assert np.abs(flight.off).max() < 0.02


def test_tags_correct_the_height_of_a_ranger_with_a_bias() -> None:
    flight = Flight(Circle(12), height=0.03)
    assert flight.off[2] == pytest.approx(0.03)
    flight.fly(12.0)
    assert abs(flight.off[2]) < 0.01


def test_the_bias_of_a_ranger_hardly_changes_in_flight() -> None:
    flight = Flight(Circle(100))
    begin = flight.filter.anchor.covariance[Z, Z]
    flight.fly(100.0, blind=True)
    grown = flight.filter.anchor.covariance[Z, Z] - begin
    assert 0.005 < math.sqrt(grown) < 0.015


def shifted(by: float) -> list[Tag]:
    """The tags, with those of one sheet aside."""
    return [
        replace(tag, position=(tag.position[0] + by, *tag.position[1:]))
        if tag.of == TAGS[4].of
        else tag
        for tag in TAGS
    ]


def test_survey_deviations_reduce_the_effect_of_moved_sheets() -> None:
    real = shifted(0.03)
    wide = CAREFUL._replace(survey=0.015, survey_turn=0.02)
    aware, surveyed = (
        Flight(Circle(11), real=real, deviations=deviations)
        for deviations in (wide, CAREFUL._replace(survey=1e-4, survey_turn=1e-4))
    )
    worst = []
    for flight in (aware, surveyed):
        far = []
        for _ in range(44):
            flight.fly(0.25)
            far.append(float(np.linalg.norm(flight.off)))
        worst.append(max(far))
    assert worst[0] < 0.7 * worst[1]


def test_systematic_errors_limit_the_gain_of_many_images() -> None:
    spreads = []
    for survey in (0.02, 1e-4):
        deviations = CAREFUL._replace(survey=survey, survey_turn=survey)
        flight = Flight(Circle(12), deviations=deviations)
        flight.fly(12.0)
        spreads.append(flight.spread)
    assert spreads[0] > 0.005  # eight sheets, one or two in view
    assert spreads[1] < 0.7 * spreads[0]


def corner(view: View, *, off: float) -> View:
    """One corner alone, beside where it was seen."""
    return view._replace(points=view.points[:1], rays=view.rays[:1] + off, delay=view.delay[:1])


def test_a_view_that_is_wrong_does_little_harm_among_right_ones() -> None:
    flight = Flight(Circle(10))
    for _ in range(50):
        flight.time += EVERY
        flight.filter.advance(flight.time, flight.track)
        measured = flight.views_at(flight.time)
        wrong = [(tag, corner(view, off=0.05)) for tag, view in measured[:1]]
        flight.filter.update([*measured, *wrong], flight.track, stamped=True)
    assert np.abs(flight.off).max() < 0.02


def test_an_image_that_is_not_finite_is_ignored(caplog: pytest.LogCaptureFixture) -> None:
    flight = Flight(Circle(10))
    flight.fly(2.0)
    before = flight.filter.anchor
    tag, view = flight.views_at(2.0)[0]
    flight.filter.update(
        [(tag, view._replace(rays=view.rays * math.nan))], flight.track, stamped=True
    )
    assert np.array_equal(flight.filter.anchor.mean, before.mean)
    assert "an image is ignored" in caplog.text
    flight.fly(1.0)
    assert np.abs(flight.off).max() < 2e-3


def test_moved_it_goes_on_there_with_what_it_learnt() -> None:
    flight = Flight(Circle(20, scale=1.06))
    flight.fly(10.0)
    factor = flight.filter.anchor.factor
    pose = Pose(rotation_from_vector(np.array([0, 0, 0.3])), np.array([3.0, 1.0, HEIGHT]))
    flight.filter.move(pose, np.eye(6) * 1e-4)
    anchor = flight.filter.anchor
    assert anchor.mean[[X, X + 1, YAW]] == pytest.approx([3.0, 1.0, 0.3])
    assert anchor.covariance[X, X] == pytest.approx(1e-4)
    assert anchor.factor == factor


def test_noise_over_a_way_is_that_of_its_legs() -> None:
    track = odometry(Circle(10))
    whole = carried(first := start(Circle(10).agent()), 3.0, track)[0]
    legs: Anchor = first
    for time in np.arange(0.1, 3.05, 0.1):
        legs = carried(legs, float(time), track)[0]
    states = [X, X + 1, Z, YAW, SLIP_X, SLIP_Y]
    assert np.sqrt(np.diag(legs.covariance))[states] == pytest.approx(
        np.sqrt(np.diag(whole.covariance))[states], rel=0.1
    )


def test_noise_turns_with_the_heading() -> None:
    track, first = odometry(Circle(10)), start(Circle(10).agent())
    turned = first.mean.copy()
    turned[YAW] += math.pi / 2
    slip_covariance = carried(first, 3.0, track)[0].covariance[[X, X + 1]][:, [SLIP_X, SLIP_Y]]
    turned_covariance = carried(first._replace(mean=turned), 3.0, track)[0].covariance
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    assert turned_covariance[[X, X + 1]][:, [SLIP_X, SLIP_Y]] == pytest.approx(
        quarter @ slip_covariance, abs=1e-12
    )


def rolling(track: OdometryTrack, time: float, rate: float) -> OdometryTrack:
    """The same odometry, of a body that is level at `time` and rolls, rad/s."""
    rows = track._rows[: track._end]  # as `OdometryTrack` keeps them
    rows[:, 5] = rate * (rows[:, 0] - time)
    return track


@pytest.mark.parametrize("rate", [0.0, 0.7])
def test_the_rates_of_roll_and_pitch_are_those_of_the_samples(rate: float) -> None:
    track = rolling(odometry(Circle(5.0)), 1.0, rate)
    assert track.at(1.0).tilt_rate == pytest.approx((rate, 0.0))
    assert track.at(99.0).tilt_rate == pytest.approx((rate, 0.0))


def test_unstamped_images_constrain_along_track_position_less() -> None:
    variances = []
    for stamped in (True, False):
        flight = Flight(Circle(5.0))
        flight.fly(3.0, blind=True)
        flight.filter.update(flight.views_at(flight.time), flight.track, stamped=stamped)
        yaw = flight.circle.body(flight.time).yaw
        ahead = np.array([math.cos(yaw), math.sin(yaw)])
        covariance = flight.filter.anchor.covariance[:2, :2]
        aside = np.array([-ahead[1], ahead[0]])
        variances.append((ahead @ covariance @ ahead, aside @ covariance @ aside))
    exact, late = variances
    assert late[0] > 1.5 * exact[0]
    assert late[1] < 1.5 * exact[1]


def test_late_images_of_a_rolling_body_do_little_harm() -> None:
    rate, late, errors = 1.0, 0.03, []
    for rolls in (True, False):
        flight = Flight(Circle(5.0))
        flight.fly(1.0)
        position = flight.circle.body(flight.time).position
        lean = Pose(rotation_from_vector(np.array([-rate * late, 0, 0])), np.zeros(3))
        body = flight.circle.body(flight.time - late) @ lean
        flight.circle.body = lambda _, then=body: then  # type: ignore[method-assign,misc]
        tag, view = flight.views_at(flight.time)[0]
        if rolls:
            rolling(flight.track, flight.time, rate)
        flight.filter.update([(tag, corner(view, off=0.0))], flight.track, stamped=False)
        errors.append(math.dist(flight.filter.anchor.mean[:2], position[:2]))
    assert errors[0] < 0.3 * errors[1]


class Pulsing(Circle):
    """A circle at a speed that rises and falls: at a constant one a latency cannot be observed."""

    def __init__(self, seconds: float) -> None:
        super().__init__(seconds)
        pace = 1 + 0.8 * np.sin(self.time)
        self.velocity *= pace
        self.yaw_rate *= pace

    def body(self, time: float) -> Pose:
        return super().body(time + 0.8 * (1 - math.cos(time)))


@pytest.mark.extended
@pytest.mark.parametrize("late", [-0.02, 0.02])
def test_the_latency_of_images_without_timestamps_is_estimated(late: float) -> None:
    flight = Flight(Pulsing(20.0))
    for k in range(1, 200):
        arrived = EVERY * k + late  # less the assumed latency
        flight.time = arrived - flight.filter.latency
        flight.filter.advance(flight.time, flight.track)
        flight.filter.update(flight.views_at(arrived - late), flight.track, stamped=False)
    assert flight.filter.latency == pytest.approx(late, abs=0.006)
    assert np.abs(flight.off).max() < 0.005


@pytest.mark.parametrize(("height", "rms"), [(0.5, 0.234), (0.75, 0.272), (1.3, 0.373)])
def test_blind_hovers_drift_as_in_the_default_world(height: float, rms: float) -> None:
    times = np.arange(0.0, 31.0, 0.1)
    still = np.zeros(len(times))
    stream = Odometry(
        agent=still.astype(np.int64),
        time=times,
        velocity=np.zeros((len(times), 3)),
        yaw_rate=still,
        roll=still,
        pitch=still,
        height=still + height,
    )
    track = OdometryTrack()
    track.add(stream, np.arange(len(times)))
    anchor, variance = start(Circle(5.0).agent()), []
    for time in np.arange(0.0, 30.5, 0.5):
        anchor, _ = carried(anchor, time, track)
        variance.append(anchor.covariance[X, X])
    grown = variance[-1] - variance[0]
    assert np.sqrt(grown) == pytest.approx(rms, rel=0.15)  # of 72 drones, over 30 s, each axis
