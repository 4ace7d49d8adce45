"""When images that were all refused are believed after all."""

from __future__ import annotations

import math

import numpy as np
import pytest

from star_apriltag.agent_estimator import (
    MAX_DISTANCE,
    MAX_TIME,
    MAX_TURN,
    MIN_IMAGES,
    Claim,
    Relocation,
)
from star_apriltag.odometry_track import OdometryTrack
from star_core import Pose
from star_core.toolkit import rotation_from_vector
from tests.plugins.localizers.apriltag.conftest import Circle

CIRCLE = Circle(20)
ELSEWHERE = np.array([1.0, -2.0, 0.0])


def track() -> OdometryTrack:
    made = OdometryTrack()
    stream = CIRCLE.odometry(0.0, np.inf)
    made.add(stream, np.arange(len(stream.agent)))
    return made


def claim(time: float, *, aside: float = 0.0, turned: float = 0.0, landmarks: str = "ab") -> Claim:
    """The claim of an image of some landmarks that was taken at the true pose."""
    body = CIRCLE.body(time)
    rotation = body.rotation @ rotation_from_vector(np.array([0.0, 0.0, turned]))
    place = body.position + ELSEWHERE + [aside, 0.0, 0.0]
    return Claim(time, Pose(rotation, place), np.eye(6) * 1e-4, frozenset(landmarks))


def considered(*claims: Claim, landmarks: int = 9) -> list[bool]:
    relocation, odometry = Relocation(landmarks), track()
    return [relocation.consider(claim, odometry) for claim in claims]


def test_claims_that_agree_through_the_odometry_are_believed() -> None:
    claims = [claim(0.5 * k) for k in range(1, MIN_IMAGES + 1)]
    assert considered(*claims) == [False] * (MIN_IMAGES - 1) + [True]


def test_a_single_landmark_does_not_relocate_an_agent() -> None:
    alone = [claim(0.1 * k, landmarks="a") for k in range(10)]
    assert not any(considered(*alone))
    assert considered(*alone, landmarks=1)[MIN_IMAGES - 1]
    assert considered(*alone, claim(1.0, landmarks="b"))[-1]
    assert not considered(*alone, claim(1.0, landmarks="b", aside=0.9))[-1]


@pytest.mark.parametrize(
    "claims",
    [
        [claim(0.1 * k, aside=1.1 * MAX_DISTANCE * (k % 2)) for k in range(MIN_IMAGES)],
        [claim(0.1 * k, aside=0.1 * k) for k in range(10)],
        [claim(0.1 * k, turned=1.1 * MAX_TURN * k) for k in range(2 * MIN_IMAGES)],
    ],
    ids=["positions disagree", "positions wander", "headings disagree"],
)
def test_claims_that_disagree_are_not_believed(claims: list[Claim]) -> None:
    assert not any(considered(*claims))


def test_headings_half_a_turn_round_agree() -> None:
    claims = [claim(0.1 * k, turned=math.pi - CIRCLE.body(0.2).yaw) for k in range(MIN_IMAGES)]
    assert considered(*claims)[-1]


def test_one_claim_that_disagrees_begins_the_count_again() -> None:
    claims = [claim(0.1 * k) for k in range(2 * MIN_IMAGES)]
    claims[MIN_IMAGES - 1] = claim(0.1 * (MIN_IMAGES - 1), aside=1.0)
    answers = considered(*claims)
    assert not any(answers[: MIN_IMAGES + 3])
    assert answers[-1]


def test_a_gap_makes_it_forget() -> None:
    before = [claim(0.1 * k) for k in range(MIN_IMAGES - 1)]
    after = [claim(before[-1].time + MAX_TIME + 0.1 * (k + 1)) for k in range(MIN_IMAGES)]
    answers = considered(*before, *after)
    assert not any(answers[:-1])
    assert answers[-1]


def test_an_image_that_was_believed_makes_it_forget() -> None:
    relocation, odometry = Relocation(9), track()
    for k in range(MIN_IMAGES - 1):
        relocation.consider(claim(0.1 * k), odometry)
    relocation.forget()
    assert not relocation.consider(claim(0.1 * MIN_IMAGES), odometry)


def test_once_believed_it_begins_again() -> None:
    answers = considered(*[claim(0.1 * k) for k in range(2 * MIN_IMAGES)])
    assert [k for k, answer in enumerate(answers) if answer] == [MIN_IMAGES - 1, 2 * MIN_IMAGES - 1]
