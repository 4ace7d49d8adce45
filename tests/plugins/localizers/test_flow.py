"""The localizer ``flow``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

import star_flow
from star_core import Agent, Array, Localizer, Scene
from star_core.testing import scene
from star_core.toolkit import fill_defaults
from star_flow.drift import Drift
from tests.plugins.localizers.conftest import report

angles = st.floats(-np.pi, np.pi)
positions = arrays(np.float64, (1, 3), elements=st.floats(-9, 9))


def facing(yaw: float, start: tuple[float, float, float] = (1.0, 2.0, 0.0)) -> Scene:
    return replace(scene(1), agents=(Agent("cf1", start, yaw),))


def flow(room: Scene, **options: float) -> Localizer:
    (offer,) = star_flow.star_localizers()
    return offer.make(room, **fill_defaults(options, offer.options))


def test_an_agent_that_has_not_moved_is_at_its_start() -> None:
    estimate = flow(facing(1.0)).locate(report([[0, 0, 0]]))
    assert estimate.position.tolist() == [[1.0, 2.0, 0.0]]
    assert estimate.yaw == pytest.approx([1.0])


def test_forward_is_along_the_heading_at_the_start() -> None:
    moving = report([[1, 0, 0.8]], velocity=np.array([[0.5, 0, 0.1]]))
    estimate = flow(facing(np.pi / 2)).locate(moving)
    assert estimate.position == pytest.approx(np.array([[1.0, 3.0, 0.8]]))
    assert estimate.velocity == pytest.approx(np.array([[0, 0.5, 0.1]]))


@given(angles, angles, positions)
def test_the_estimate_is_the_report_moved_by_the_transform(
    start: float, yaw: float, position: Array
) -> None:
    estimate = flow(facing(start)).locate(report(position, yaw=yaw))
    assert estimate.position == pytest.approx(estimate.map_from_odom.apply(position))
    assert np.cos(estimate.yaw) == pytest.approx([np.cos(start + yaw)], abs=1e-9)
    assert np.sin(estimate.yaw) == pytest.approx([np.sin(start + yaw)], abs=1e-9)
    assert abs(estimate.yaw[0]) <= np.pi


@given(angles, st.floats(-0.4, 0.4), st.floats(-0.4, 0.4))
def test_a_tilt_does_not_change_the_heading(yaw: float, roll: float, pitch: float) -> None:
    attitude = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat()[None]
    estimate = flow(facing(0.0)).locate(report([[0, 0, 1]], attitude=attitude))
    assert np.exp(1j * estimate.yaw) == pytest.approx(np.exp([1j * yaw]), abs=1e-9)


@pytest.mark.parametrize(
    ("age", "valid"), [(0.0, True), (0.5, True), (0.51, False), (np.nan, False), (np.inf, False)]
)
def test_a_row_is_valid_while_the_agent_was_heard(age: float, valid: bool) -> None:  # noqa: FBT001
    estimate = flow(facing(0.0)).locate(report([[0, 0, 1]], age=np.array([age])))
    assert estimate.valid.tolist() == [valid]


def test_how_old_a_report_may_be_is_an_option() -> None:
    estimate = flow(facing(0.0), max_report_age=2.0).locate(
        report([[0, 0, 1]], age=np.array([1.5]))
    )
    assert estimate.valid.tolist() == [True]


@pytest.mark.parametrize("field", ["position", "velocity", "attitude"])
def test_unreported_agents_are_invalid_and_keep_their_position(field: str) -> None:
    localizer = flow(facing(0.0))
    before = localizer.locate(report([[1, 0, 1]], yaw=0.5))
    gone = {field: np.full_like(getattr(report([[0, 0, 0]]), field), np.nan)}
    estimate = localizer.locate(replace(report([[2, 0, 1]]), **gone))
    assert estimate.valid.tolist() == [False]
    assert estimate.position.tolist() == before.position.tolist()
    assert estimate.yaw == pytest.approx([0.5])
    assert np.isfinite(estimate.covariance).all()


HOVER = np.array([0.0, 0.0, 0.8])  # m


def fly(start: Array, track: Array, yaw: Array | None = None, period: float = 0.05) -> Array:
    """(T, 3, 3) covariances along a (T, 3) track, with (T,) headings or without turning."""
    yaw = np.zeros(len(track)) if yaw is None else yaw
    drift = Drift(start[None], yaw[:1])
    return np.array(
        [
            drift.covariance(i * period, position[None], yaw[i : i + 1])[0]
            for i, position in enumerate(track)
        ]
    )


@given(st.integers(0, 1000))
def test_a_covariance_is_one(seed: int) -> None:
    track = np.cumsum(np.random.default_rng(seed).normal(0, 0.02, (60, 3)), axis=0)
    covariance = fly(np.zeros(3), track)
    assert covariance == pytest.approx(covariance.transpose(0, 2, 1))
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_uncertainty_grows_with_time_and_with_distance() -> None:
    out = np.linspace(0, 1, 200)[:, None] * [3.0, 0, 0] + [0, 0, 1]
    stay, away = (np.trace(c, axis1=1, axis2=2) for c in (fly(out[0], out * 0), fly(out[0], out)))
    assert (np.diff(stay) > 0).all()
    assert (np.diff(away) > 0).all()
    assert away[-1] > 2 * stay[-1]


@given(angles)
def test_the_covariance_turns_with_the_way(angle: float) -> None:
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    track = np.cumsum(np.random.default_rng(3).normal(0.02, 0.02, (40, 3)), axis=0)
    turned = turn @ fly(np.zeros(3), track) @ turn.T
    assert fly(np.zeros(3), track @ turn.T) == pytest.approx(turned)


def test_a_yaw_bias_throws_off_across_the_way() -> None:
    track = np.linspace(0, 1, 2400)[:, None] * [20.0, 0, 0]  # two minutes straight along x
    last = fly(track[0], track)[-1]
    assert last[1, 1] > last[0, 0]


def test_drift_over_three_laps_matches_the_default_world() -> None:
    turned = np.linspace(0, 6 * np.pi, round(135.0 / 0.05))
    track = 1.97 * np.stack([np.cos(turned), np.sin(turned), 0 * turned], axis=1)
    covariance = fly(track[0], track + HOVER, turned + np.pi / 2)
    expected = (covariance[:, 0, 0] + covariance[:, 1, 1]).mean()  # m², mean square error
    assert expected == pytest.approx(0.70, rel=0.2)  # Table 1 of docs/results.md


def test_a_hover_drifts_as_much_as_in_the_default_world() -> None:
    last = fly(np.zeros(3), np.zeros((round(115.0 / 0.05), 3)) + HOVER)[-1]
    assert np.sqrt(last[0, 0]) == pytest.approx(0.74, rel=0.1)  # of 32 drones, RMS of each axis


@pytest.mark.parametrize(("height", "rms"), [(0.5, 0.234), (0.75, 0.272), (1.3, 0.373)])
def test_drift_grows_with_the_height_as_in_the_default_world(height: float, rms: float) -> None:
    track = np.zeros((round(30.0 / 0.05), 3))
    track[:, 2] = height
    covariance = fly(np.zeros(3), track)
    grown = covariance[-1, 0, 0] - covariance[0, 0, 0]
    assert np.sqrt(grown) == pytest.approx(rms, rel=0.15)  # of 72 drones, over 30 s, each axis


def test_constant_velocity_errors_cancel_over_a_turn() -> None:
    still = np.zeros((round(120.0 / 0.05), 3))
    turning = fly(still[0], still, np.linspace(0, 8 * np.pi, len(still)))[-1]
    assert turning[0, 0] < 0.5 * fly(still[0], still)[-1][0, 0]


def errors(seconds: float, period: float = 0.05, seed: int = 0, n: int = 40) -> Array:
    """(T, N, 3) what is added on purpose to agents that stand still."""
    room = scene(n, seed=seed)
    localizer = flow(room, error_std=0.03, error_time_constant=1.0)
    starts = np.array([agent.start for agent in room.agents])
    still = np.zeros((n, 3))
    times = np.arange(round(seconds / period)) * period
    return np.array([localizer.locate(report(still, time=t)).position - starts for t in times])


def test_by_default_no_error_is_added() -> None:
    estimate = flow(scene(3)).locate(report(np.zeros((3, 3))))
    assert estimate.position.tolist() == [list(agent.start) for agent in scene(3).agents]


def test_an_artificial_error_has_its_size_from_the_first_tick_on() -> None:
    error = errors(40.0)
    assert error[0].std() == pytest.approx(0.03, rel=0.25)
    assert error.std() == pytest.approx(0.03, rel=0.05)
    assert error.mean() == pytest.approx(0.0, abs=0.003)


@pytest.mark.parametrize(("lag", "kept"), [(0.5, np.exp(-0.5)), (1.0, np.exp(-1)), (3.0, 0.05)])
def test_an_artificial_error_is_forgotten_with_its_time_constant(lag: float, kept: float) -> None:
    error, ticks = errors(60.0), round(lag / 0.05)
    correlation = (error[ticks:] * error[:-ticks]).mean() / (error**2).mean()
    assert correlation == pytest.approx(kept, abs=0.06)


def test_an_artificial_error_does_not_depend_on_the_rate() -> None:
    assert errors(60.0, period=0.2).std() == pytest.approx(errors(60.0).std(), rel=0.1)


def test_artificial_errors_are_seeded_and_differ_per_agent() -> None:
    assert np.array_equal(errors(1.0, seed=3), errors(1.0, seed=3))
    assert not np.array_equal(errors(1.0, seed=3), errors(1.0, seed=4))
    assert errors(1.0, n=2) == pytest.approx(errors(1.0, n=5)[:, :2], abs=1e-12)
    assert len(np.unique(errors(1.0)[0])) == 40 * 3


def test_exact_odometry_has_no_drift_but_the_artificial_error() -> None:
    room = replace(facing(0.0), exact_odometry=True)
    calm, shaken = flow(room), flow(room, error_std=0.03)
    for second in range(60):
        away = report([[0.5 * second, 0, 0.8]], time=float(second))
        std, noisy = (
            np.sqrt(localizer.locate(away).covariance[0].diagonal()) for localizer in (calm, shaken)
        )
    assert std.max() <= 0.002
    assert noisy == pytest.approx([0.03] * 3, rel=0.01)


def test_the_covariance_includes_the_artificial_error() -> None:
    at = report([[1, 0, 0.8]])
    without = flow(facing(0.0)).locate(at).covariance
    assert flow(facing(0.0), error_std=0.03).locate(at).covariance == pytest.approx(
        without + 0.03**2 * np.eye(3)
    )


def test_an_artificial_error_is_no_drift() -> None:
    away = [report([[0, 0, 0.8]], time=0.05 * i) for i in range(600)]
    shaken, calm = flow(facing(0.0), error_std=0.03), flow(facing(0.0))
    last = [(shaken.locate(at).covariance, calm.locate(at).covariance) for at in away][-1]
    assert last[0] == pytest.approx(last[1] + 0.03**2 * np.eye(3))


def test_unreported_agents_keep_positions_with_artificial_error() -> None:
    localizer = flow(facing(0.0), error_std=0.03)
    before = localizer.locate(report([[1, 0, 1]]))
    gone = report([[np.nan] * 3], time=1.0)
    assert localizer.locate(gone).position.tolist() == before.position.tolist()
