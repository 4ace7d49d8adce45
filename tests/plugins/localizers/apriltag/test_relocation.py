"""When images that were all refused are believed after all."""

from __future__ import annotations

import math

import gtsam
import numpy as np

from star_apriltag.odometry_track import Track
from star_apriltag.relocation import APART, IMAGES, TURNED, Claim, Relocation
from tests.plugins.localizers.apriltag.conftest import Circle

CIRCLE = Circle(20)
ELSEWHERE = np.array([1.0, -2.0, 0.0])


def track() -> Track:
    made = Track()
    stream = CIRCLE.odometry(0.0, np.inf)
    made.add(stream, np.arange(len(stream.agent)))
    return made


def claim(time: float, *, aside: float = 0.0, turned: float = 0.0) -> Claim:
    """What an image says that was taken where the agent really is."""
    body = CIRCLE.body(time)
    rotation = gtsam.Rot3(body.rotation).compose(gtsam.Rot3.Yaw(turned))
    place = body.position + ELSEWHERE + [aside, 0.0, 0.0]
    return Claim(time, gtsam.Pose3(rotation, place), np.eye(6) * 1e-4)


def considered(*claims: Claim) -> list[Claim | None]:
    relocation, odometry = Relocation(), track()
    return [relocation.consider(one, odometry) for one in claims]


def test_claims_that_agree_through_the_odometry_are_believed() -> None:
    claims = [claim(0.5 * k) for k in range(1, IMAGES + 1)]
    assert considered(*claims) == [None] * (IMAGES - 1) + [claims[-1]]


def test_fewer_are_not() -> None:
    assert considered(*[claim(0.1 * k) for k in range(IMAGES - 1)]) == [None] * (IMAGES - 1)


def test_places_that_disagree_are_not_believed() -> None:
    claims = [claim(0.1 * k, aside=1.1 * APART * (k % 2)) for k in range(2 * IMAGES)]
    assert not any(considered(*claims[:IMAGES]))


def test_places_that_wander_are_not_believed() -> None:
    assert not any(considered(*[claim(0.1 * k, aside=0.1 * k) for k in range(10)]))


def test_headings_that_disagree_are_not_believed() -> None:
    claims = [claim(0.1 * k, turned=1.1 * TURNED * k) for k in range(2 * IMAGES)]
    assert not any(considered(*claims))


def test_headings_half_a_turn_round_agree() -> None:
    claims = [claim(0.1 * k, turned=math.pi - CIRCLE.body(0.2).yaw) for k in range(IMAGES)]
    assert considered(*claims)[-1] is claims[-1]


def test_one_claim_that_disagrees_begins_the_count_again() -> None:
    claims = [claim(0.1 * k) for k in range(2 * IMAGES)]
    claims[IMAGES - 1] = claim(0.1 * (IMAGES - 1), aside=1.0)
    answers = considered(*claims)
    assert not any(answers[: IMAGES + 3])
    assert answers[-1] is not None


def test_a_gap_makes_it_forget() -> None:
    before = [claim(0.1 * k) for k in range(IMAGES - 1)]
    after = [claim(before[-1].time + 3.1 + 0.1 * k) for k in range(IMAGES)]
    answers = considered(*before, *after)
    assert not any(answers[:-1])
    assert answers[-1] is after[-1]


def test_an_image_that_was_believed_makes_it_forget() -> None:
    relocation, odometry = Relocation(), track()
    for k in range(IMAGES - 1):
        relocation.consider(claim(0.1 * k), odometry)
    relocation.forget()
    assert relocation.consider(claim(0.1 * IMAGES), odometry) is None


def test_once_believed_it_begins_again() -> None:
    answers = considered(*[claim(0.1 * k) for k in range(2 * IMAGES)])
    assert [k for k, answer in enumerate(answers) if answer] == [IMAGES - 1, 2 * IMAGES - 1]
