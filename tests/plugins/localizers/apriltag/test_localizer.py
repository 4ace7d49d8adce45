"""The localizer on a flight whose images are exact, and on telemetry that is not right."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from star_apriltag.agent_group import TickInput, TickOutput
from star_core import Detections, Estimate, Frames, Image, Odometry, Supervisor, Telemetry
from tests.plugins.localizers.apriltag.conftest import (
    HEIGHT,
    RADIUS,
    TICK,
    Circle,
    blank,
    flight,
    flown,
    localizer,
    marked,
    off,
    room,
    sheets,
    telemetry,
    ticks,
)

TAGS = sheets()
SCALE = complex(1.1, 0.0)  # odometry that is a tenth short
DRIFTING = Circle(12, scale=SCALE)


@pytest.fixture(scope="module")
def estimates() -> list[Estimate]:
    """Return those of a flight whose odometry drifts, with all tags."""
    return flight(DRIFTING, TAGS)


@cache
def without_tags(seconds: float, scale: complex = 1.0) -> list[Estimate]:
    """Return the estimates of a flight that sees no tag."""
    return flight(Circle(seconds, scale=scale))


def spread(estimates: list[Estimate], row: int = 0) -> list[float]:
    """Deviation of the place along its worst direction, m."""
    return [math.sqrt(np.linalg.eigvalsh(e.covariance[row])[-1]) for e in estimates]


def same(flight: list[Estimate], again: list[Estimate], row: int = 0) -> bool:
    """Whether a row of a flight's estimates is the first of another's, to the last bit."""
    return all(
        np.array_equal(a.position[row], b.position[0])
        and np.array_equal(a.covariance[row], b.covariance[0])
        and a.yaw[row] == b.yaw[0]
        and a.valid[row] == b.valid[0]
        for a, b in zip(flight, again, strict=True)
    )


def framed(heard: Telemetry, *images: Image) -> Telemetry:
    """With images that were taken just then."""
    when = np.full(len(images), heard.time - 0.15)
    frames = Frames(np.zeros(len(images), np.int64), when, when + 0.15, images)
    return replace(heard, frames=frames)


def finite(estimate: Estimate) -> bool:
    parts = (estimate.position, estimate.velocity, estimate.yaw, estimate.covariance)
    return all(np.isfinite(part).all() for part in parts)


def test_it_stays_on_the_truth_though_odometry_drifts(estimates: list[Estimate]) -> None:
    assert off(estimates, DRIFTING)[100:].max() < 0.03
    assert all(e.valid.all() for e in estimates)


def test_odometry_continues_without_tags_with_growing_deviation() -> None:
    circle = Circle(10)
    estimates = flight(circle)
    assert off(estimates, circle).max() < 1e-3
    assert (np.diff(spread(estimates)[::20]) > 0).all()


def test_with_one_tag_of_each_landmark_the_others_do_not_matter() -> None:
    circle = Circle(5, scale=SCALE)
    first_of_each = flight(circle, TAGS, max_tags_per_landmark=1)
    assert same(first_of_each, flight(circle, TAGS[::2], landmarks=TAGS[::2]))


def test_learnt_gyro_bias_does_not_turn_agents_at_rest() -> None:
    circle = Circle(20, yaw_bias=math.radians(0.4))
    made = localizer(room([circle], TAGS))
    (*_, before) = flown(made, [circle], 20.0, TAGS)
    assert off([before], circle) < 0.02
    now, zero = 20.0, np.zeros(100)
    for state, turned in ((0, 0.0), (int(Supervisor.FLYING), 60.0)):
        for _ in range(60):
            time = now + np.linspace(0.01, 1.0, 100)
            still = Odometry(np.zeros(100, int), time, np.zeros((100, 3)), zero, zero, zero, zero)
            now += 1.0
            heard = replace(telemetry([circle], 20.0), time=now, velocity=np.zeros((1, 3)))
            estimate = made.locate(replace(heard, odometry=still, state=np.array([state])))
        learnt = -made._reckoners[0].anchor.yaw_bias
        assert abs(learnt) > math.radians(0.2)
        yaw = estimate.yaw[0] - before.yaw[0]
        assert yaw == pytest.approx(turned * learnt, abs=math.radians(1.0))
        assert estimate.position == pytest.approx(before.position, abs=2e-3)  # in a minute


def test_where_its_odometry_frame_lies_makes_up_for_drift() -> None:
    circle = Circle(5)
    made = localizer(room([circle], TAGS))
    for heard in ticks([circle], 5.0, TAGS):
        moved = replace(heard, position=heard.position + np.array([0.3, -0.2, 0.0]))
        estimate = made.locate(moved)
        assert estimate.map_from_odom.apply(moved.position) == pytest.approx(estimate.position)


@pytest.mark.parametrize(
    "image",
    [
        blank(),
        blank(255),
        blank(128)[:100],
        blank(128)[:, :100],
        blank(0, 1, 1),
        np.zeros((244, 324), np.float64),
        np.zeros((244, 324, 3), np.uint8),
        np.zeros((0, 0), np.uint8),
        np.random.default_rng(0).integers(0, 256, (244, 324), np.uint8),
    ],
    ids=["black", "white", "cut", "narrow", "a pixel", "floats", "colours", "empty", "noise"],
)
def test_an_image_that_shows_nothing_changes_nothing(image: Image) -> None:
    spoilt = flight(Circle(1), change=lambda heard: framed(heard, image))
    assert same(spoilt, without_tags(1))


def test_an_image_that_a_stuck_camera_repeats_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    circle = Circle(1)
    made = localizer(room([circle], TAGS))
    used: list[int] = []
    update = made._pool.update

    def counted(tick: TickInput) -> TickOutput:
        used.append(sum(report.image is not None for report in tick.images))
        return update(tick)

    monkeypatch.setattr(made._pool, "update", counted)
    for time, gray in (0.5, 3), (0.55, 3), (0.6, 4):
        made.locate(framed(telemetry([circle], time), blank(gray)))
    assert used == [1, 0, 1]


def test_an_image_of_a_wrong_size_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    circle = Circle(1)
    localizer(room([circle], TAGS)).locate(framed(telemetry([circle], 0.5), blank(0, 9, 9)))
    assert "image is (9, 9) of uint8, expected (244, 324) of uint8" in caplog.text


@pytest.mark.parametrize("method", ["filter", "batch"])
@pytest.mark.parametrize("stamped", [True, False])
def test_detections_are_published_with_the_time_of_their_image(
    method: str,
    stamped: bool,  # noqa: FBT001 -- whether the camera has a clock
) -> None:
    made = localizer(room([circle := Circle(1)], TAGS), method=method)
    heard = framed(telemetry([circle], 0.5), marked(77))
    if not stamped:
        heard = replace(heard, frames=replace(heard.frames, taken=np.full(1, np.nan)))
    assert not len(made.locate(heard).detections.tag)  # that image is analyzed beside the next tick
    detections = made.locate(telemetry([circle], 0.6)).detections
    assert (detections.agent.tolist(), detections.tag.tolist()) == ([0], [77])
    np.testing.assert_allclose(detections.corners.min(axis=1), [[99.5, 79.5]], atol=0.6)
    np.testing.assert_allclose(detections.corners.max(axis=1), [[199.5, 179.5]], atol=0.6)
    np.testing.assert_array_equal(detections.taken, heard.frames.taken)
    np.testing.assert_array_equal(detections.time, heard.frames.time)
    assert "landmark" in detections.rejected[0]
    assert not len(made.locate(telemetry([circle], 0.7)).detections.tag)


def test_an_image_of_an_agent_without_a_camera_is_excluded() -> None:
    circle = Circle(1)
    made = localizer(room([circle], TAGS, camera=None))
    assert finite(made.locate(framed(telemetry([circle], 0.5), blank())))


def unstamped(heard: Telemetry) -> Telemetry:
    detections = heard.detections
    return replace(
        heard, detections=replace(detections, taken=np.full(len(detections.tag), np.nan))
    )


def test_unstamped_tags_are_dated_back_by_the_latency(estimates: list[Estimate]) -> None:
    made = localizer(room([DRIFTING], TAGS), latency=0.15, latency_std=0.0)
    without = flown(made, [DRIFTING], 8.0, TAGS, change=unstamped)
    stamped = estimates[: len(without)]
    assert np.abs(off(stamped, DRIFTING) - off(without, DRIFTING)).max() < 1e-3


def test_a_latency_that_is_not_so_shifts_the_agent_along_its_way() -> None:
    circle = Circle(4)
    wrong = localizer(room([circle], TAGS), latency=0.45)
    assert off(flown(wrong, [circle], 4.0, TAGS, change=unstamped), circle)[-1] > 0.05


def test_images_out_of_order_do_no_harm() -> None:
    circle = Circle(8, scale=SCALE)
    made = localizer(room([circle], TAGS))
    estimates = []
    for k in range(1, 160):
        taken = k * TICK - (0.35 if k % 4 == 0 else 0.15)
        heard = telemetry([circle], k * TICK, TAGS, taken=max(taken, 0.0))
        estimates.append(made.locate(heard))
    assert off(estimates, circle)[100:].max() < 0.03


def changed(heard: Telemetry, *, later: float = 0.0, number: int = 0) -> Telemetry:
    """With images at other times, s, and tags with other numbers."""
    detections = heard.detections
    detections = replace(detections, taken=detections.taken + later, tag=detections.tag + number)
    return replace(heard, detections=detections)


IGNORED: dict[str, dict[str, Any]] = {
    "no camera": {"camera": None},
    "no tag of a landmark in use": {"max_tags_per_landmark": 0},
    "a clock that is slow": {"change": partial(changed, later=-100.0)},
    "a clock that is fast": {"change": partial(changed, later=100.0)},
    "a clock of another epoch": {"change": partial(changed, later=1e9)},
    "unknown tags": {"change": partial(changed, number=300)},
}


@pytest.mark.parametrize("how", IGNORED.values(), ids=list(IGNORED))
def test_what_is_not_used_changes_nothing(how: dict[str, Any]) -> None:
    circle = Circle(2, scale=SCALE)
    assert same(flight(circle, TAGS, **how), without_tags(2, SCALE))


@pytest.mark.parametrize("value", [math.nan, math.inf, -1e6, 1e9])
def test_corners_that_make_no_sense_change_nothing(value: float) -> None:
    circle = Circle(2)

    def spoilt(heard: Telemetry) -> Telemetry:
        detections = heard.detections
        return replace(
            heard, detections=replace(detections, corners=0 * detections.corners + value)
        )

    with np.errstate(invalid="ignore"):
        nonsense = flight(circle, TAGS, change=spoilt)
    assert all(finite(estimate) for estimate in nonsense)
    assert off(nonsense, circle).max() < 1e-3


def test_agents_without_position_reports_keep_their_odom_frame() -> None:
    circle = Circle(6, scale=SCALE)
    made = localizer(room([circle], TAGS))
    estimates = []
    for heard in ticks([circle], 6.0, TAGS):
        if heard.time > 3.0:
            estimates.append(made.locate(replace(heard, position=heard.position * np.nan)))
        else:
            frames = made.locate(heard).map_from_odom
    for estimate in estimates:
        assert np.array_equal(estimate.map_from_odom.yaw, frames.yaw)
        assert np.array_equal(estimate.map_from_odom.translation, frames.translation)
        assert finite(estimate)
        assert not estimate.valid[0]


def test_initial_odometry_frames_lie_at_the_start() -> None:
    circle = Circle(1)
    heard = telemetry([circle], 0.05)
    frames = (
        localizer(room([circle], TAGS))
        .locate(replace(heard, position=heard.position * np.nan, odometry=Odometry.none()))
        .map_from_odom
    )
    assert frames.translation[0] == pytest.approx([RADIUS, 0.0, HEIGHT])
    assert frames.yaw[0] == pytest.approx(math.pi / 2)


def test_a_report_that_is_stale_is_not_flown_on() -> None:
    circle = Circle(1)
    made = localizer(room([circle], TAGS), max_report_age=0.5)
    heard = telemetry([circle], 0.5)
    assert made.locate(replace(heard, age=np.array([0.5]))).valid[0]
    assert not made.locate(replace(heard, age=np.array([0.51]))).valid[0]
    assert not made.locate(replace(heard, age=np.array([np.nan]))).valid[0]


def test_estimates_are_invalid_beyond_the_maximum_deviation() -> None:
    circle = Circle(20)
    estimates = flight(circle, max_position_std=0.08)
    fit = np.array([e.valid[0] for e in estimates])
    assert np.array_equal(fit, np.array(spread(estimates)) <= 0.08)
    assert fit[0]
    assert not fit[-1]


def test_covariance_is_bounded_below_by_map_and_start() -> None:
    estimates = flight(Circle(6), TAGS, survey_std=0.05)
    least = min(np.linalg.eigvalsh(e.covariance[0, :2, :2])[0] for e in estimates)
    assert least >= 0.9 * 0.05**2 / (len(TAGS) / 2 + 1)


def found_again(seconds: float, aside: float, turned_by: float) -> tuple[float, list[Estimate]]:
    """A flight with another start than the mission's: when it saw a tag, and estimates."""
    circle = Circle(seconds)
    scene = room([circle], TAGS)
    (agent,) = scene.agents
    x, y, z = agent.start
    moved = replace(agent, start=(x + aside, y, z), yaw=agent.yaw + turned_by)
    made, estimates, first = localizer(replace(scene, agents=(moved,))), [], math.inf
    for heard in ticks([circle], seconds, TAGS):
        if len(heard.detections.tag):
            first = min(first, heard.time)
        estimates.append(made.locate(heard))
    return first, estimates


@pytest.mark.parametrize(("aside", "turned_by"), [(1.0, 25.0), (-1.0, -25.0), (0.0, 180.0)])
def test_wrong_starts_are_corrected_within_three_seconds_of_tags(
    aside: float, turned_by: float
) -> None:
    first, estimates = found_again(6.0, aside, math.radians(turned_by))
    far = off(estimates, Circle(6.0))
    after = [error for e, error in zip(estimates, far, strict=True) if e.time > first + 3.0]
    assert max(after) < 0.25


def test_one_agents_estimate_does_not_depend_on_another(estimates: list[Estimate]) -> None:
    other, far = Circle(4, seed=3, centre=(6.0, 0.0)), sheets(centre=(6.0, 0.0), first=50)
    both = flown(localizer(room([DRIFTING, other], TAGS + far)), [DRIFTING, other], 4.0, TAGS + far)
    assert same(both, estimates[: len(both)])
    assert same(both, flight(other, far, landmarks=far), row=1)


def test_two_flights_are_the_same_to_the_last_bit() -> None:
    circle = Circle(3, seed=1)
    first, second = (flight(circle, TAGS) for _ in range(2))
    assert same(first, second)


@pytest.mark.parametrize("taken", [math.nan, -1.0, 0.0])
def test_a_camera_that_saw_before_the_mission_began_is_excluded(taken: float) -> None:
    circle = Circle(1)
    heard = telemetry([circle], 0.1, TAGS, taken=0.0)
    n = len(heard.detections.tag)
    old = replace(heard.detections, taken=np.full(n, taken), arrived=np.full(n, 0.05))
    assert finite(localizer(room([circle], TAGS)).locate(replace(heard, detections=old)))


def test_flights_without_any_report_stay_at_the_start() -> None:
    circle = Circle(1)
    made = localizer(room([circle], TAGS))
    heard = telemetry([circle], 5.0)
    nothing = replace(
        heard,
        position=heard.position * np.nan,
        velocity=heard.velocity * np.nan,
        attitude=heard.attitude * np.nan,
        odometry=Odometry.none(),
        detections=Detections.none(),
        age=np.array([np.inf]),
    )
    estimate = made.locate(nothing)
    assert finite(estimate)
    assert estimate.position[0] == pytest.approx([RADIUS, 0.0, HEIGHT])
    assert not estimate.valid[0]
