import math

import numpy as np
import pytest

from star_apriltag.vision.body_pose import Fix, Verdict, judge, surprise, tilt
from star_core import Pose
from tests.plugins.localizers.vision.conftest import hovering

SURE = np.zeros((3, 3))


def fix(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, misfit: float = 1.0) -> Fix:
    return Fix(hovering(x, y, yaw), np.eye(6), misfit)


@pytest.mark.parametrize(
    ("pose", "expected", "squared"),
    [
        (hovering(), hovering(), 0),
        (hovering(x=0.05), hovering(), 1),
        (hovering(y=0.10), hovering(), 4),
        (hovering(yaw=math.radians(-6)), hovering(), 9),
        (hovering(yaw=math.radians(179)), hovering(yaw=math.radians(-179)), 1),
    ],
)
def test_a_fix_at_a_metre_is_good_for_five_centimetres_and_two_degrees(
    pose: Pose, expected: Pose, squared: float
) -> None:
    assert surprise(pose, 1.0, expected, SURE) == pytest.approx(squared)


def test_surprise_is_measured_along_the_axes_of_the_covariance() -> None:
    long = np.diag([0.0, 0.0, 1.0])
    long[:2, :2] = [[0.5, 0.5], [0.5, 0.5]]  # along the diagonal
    along = surprise(hovering(0.3, 0.3), 1.0, hovering(), long)
    across = surprise(hovering(0.3, -0.3), 1.0, hovering(), long)
    assert along < 1
    assert across > 25


@pytest.mark.parametrize(
    ("candidate", "verdict"),
    [
        (fix(), Verdict.ACCEPTED),
        (fix(x=0.24), Verdict.ACCEPTED),
        (fix(x=0.26), Verdict.ELSEWHERE),
        (fix(yaw=math.radians(11)), Verdict.ELSEWHERE),
        (fix(misfit=5.9), Verdict.ACCEPTED),
        (fix(misfit=6.1), Verdict.MISFIT),
        (fix(misfit=math.nan), Verdict.MISFIT),
    ],
)
def test_a_fix_is_believed_within_five_deviations(candidate: Fix, verdict: Verdict) -> None:
    assert judge(candidate, 1.0, hovering(), SURE)[0] is verdict


def test_a_covariance_that_is_no_number_lets_nothing_pass() -> None:
    assert judge(fix(), 1.0, hovering(), np.full((3, 3), np.nan))[0] is Verdict.ELSEWHERE


def test_tilt_is_the_angle_between_two_ups() -> None:
    level = hovering().rotation[2]
    assert tilt(hovering(pitch=0.3, yaw=1.0), level) == pytest.approx(0.3)
