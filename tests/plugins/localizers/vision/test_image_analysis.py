import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from star_apriltag.vision.body_pose import Prediction, Verdict
from star_apriltag.vision.image_analysis import ImageAnalysis, ImageAnalyzer
from star_apriltag.vision.tag_poses import corner_std
from star_core import Array, Camera, Pose, Rows, Tag
from star_core.toolkit import CameraModel, rotation_from_vector
from tests.plugins.localizers.vision.conftest import (
    LENS,
    hovering,
    in_map,
    on_floor,
    on_wall,
    paint,
    predicted,
    tag_corners,
    turned_model,
)

LANDMARKS = [on_floor(1, 0.7, -0.105, yaw=0.3), on_floor(2, 0.7, 0.105, yaw=0.3)]
TARGET = on_floor(9, 0.8, 0.3, yaw=-0.8)


def eye(tags: Sequence[Tag]) -> ImageAnalyzer:
    return ImageAnalyzer(Camera(), tags, {TARGET.id: TARGET.size}, guided_matching=True)


def table(body: Pose, tags: Sequence[Tag], lens: CameraModel = LENS) -> tuple[Rows, Array]:
    corners = [tag_corners(body, tag, lens) for tag in tags]
    assert all(c is not None for c in corners)
    return np.array([tag.id for tag in tags]), np.array(corners)


def considered(body: Pose, tags: Sequence[Tag]) -> ImageAnalysis:
    return eye(LANDMARKS).evaluate(*table(body, tags), predicted(body))


def verdicts(look: ImageAnalysis) -> list[Verdict]:
    return [landmark.verdict for landmark in look.landmarks]


def test_an_image_of_landmarks_gives_the_pose_of_the_body() -> None:
    body = hovering(0.05, -0.1, yaw=0.2, pitch=0.05)
    expected = predicted(body)
    off = replace(
        expected, pose=Pose(expected.pose.rotation, body.position + np.array([0.1, -0.1, 0]))
    )
    look = eye(LANDMARKS).analyze(paint(body, LANDMARKS), off)
    assert verdicts(look) == [Verdict.ACCEPTED] * 2
    assert look.fix is not None
    np.testing.assert_allclose(look.fix.pose.position, body.position, atol=0.01)
    assert look.fix.pose.yaw == pytest.approx(body.yaw, abs=math.radians(0.7))


def test_an_empty_image_gives_nothing() -> None:
    look = eye(LANDMARKS).analyze(np.zeros(LENS.shape, np.uint8), predicted(hovering()))
    assert look == ImageAnalysis()


def test_two_tags_that_were_taken_for_each_other_are_turned_away() -> None:
    far = [LANDMARKS[0], on_floor(2, -1.0, 1.0)]
    _, corners = table(hovering(), LANDMARKS)
    look = eye(far).evaluate(np.array([2, 1]), corners, predicted(hovering()))
    assert verdicts(look) == [Verdict.ELSEWHERE, Verdict.ACCEPTED] or not look.accepted
    assert not [s for s in look.accepted if s.tag == 2]


def test_a_wrong_number_among_right_ones_does_not_move_the_fix() -> None:
    landmarks = [*LANDMARKS, on_floor(3, -1.4, 1.4)]
    _, corners = table(hovering(), LANDMARKS)
    look = eye(landmarks).evaluate(np.array([1, 3]), corners, predicted(hovering()))
    assert verdicts(look) == [Verdict.ACCEPTED, Verdict.ELSEWHERE]
    assert look.fix is not None
    np.testing.assert_allclose(look.fix.pose.position, hovering().position, atol=1e-4)


def test_the_more_surprising_of_inconsistent_tags_is_rejected() -> None:
    landmarks = [*LANDMARKS, on_floor(3, 0.7, -0.315, yaw=0.3)]  # as near to 1 as 2 is
    _, corners = table(hovering(), LANDMARKS)
    look = eye(landmarks).evaluate(np.array([1, 3]), corners, predicted(hovering(), deviation=0.3))
    assert verdicts(look) == [Verdict.ACCEPTED, Verdict.INCONSISTENT]
    assert look.fix is not None
    np.testing.assert_allclose(look.fix.pose.position, hovering().position, atol=1e-4)


def test_tags_with_two_centimetres_of_map_error_are_accepted() -> None:
    landmarks = [on_floor(1, 0.72, -0.105, yaw=0.3), on_floor(2, 0.7, 0.125, yaw=0.33)]
    look = eye(landmarks).evaluate(*table(hovering(), LANDMARKS), predicted(hovering()))
    assert verdicts(look) == [Verdict.ACCEPTED] * 2


def test_an_agent_that_is_elsewhere_is_still_found() -> None:
    body = hovering(yaw=0.1)
    lost = replace(predicted(body), pose=hovering(1.0, 0.4, yaw=0.5))
    look = eye(LANDMARKS).evaluate(*table(body, LANDMARKS), lost)
    assert verdicts(look) == [Verdict.ELSEWHERE] * 2
    assert look.fix is None
    assert look.other is not None
    np.testing.assert_allclose(look.other.pose.position, body.position, atol=1e-4)


def test_inconsistent_tags_far_from_the_prediction_give_no_pose() -> None:
    moved = [on_floor(1, -1.0, 0.3), on_floor(2, 1.5, 1.0, yaw=2.0)]
    look = eye(moved).evaluate(*table(hovering(), LANDMARKS), predicted(hovering()))
    assert verdicts(look) == [Verdict.ELSEWHERE] * 2
    assert look.other is None


def test_poses_contradicting_the_on_board_tilt_are_rejected() -> None:
    body = hovering()
    wrong = replace(predicted(body), pose=hovering(roll=math.radians(40)))
    look = eye(LANDMARKS).evaluate(*table(body, LANDMARKS), wrong)
    assert verdicts(look) == [Verdict.TILTED] * 2


def test_corners_that_are_no_square_are_turned_away() -> None:
    broken = np.array([[[10.0, 10], [90, 10], [np.nan, 50], [10, 50]]])
    look = eye(LANDMARKS).evaluate(np.array([1]), broken, predicted(hovering()))
    assert verdicts(look) == [Verdict.UNSOLVED]
    assert look.fix is None


def test_a_tag_with_an_unknown_number_is_ignored() -> None:
    look = considered(hovering(), [on_floor(77, 0.7, 0.0)])
    assert not look.landmarks
    assert not look.targets


@pytest.mark.parametrize("wall", [False, True])
def test_the_right_one_of_two_solutions_is_chosen(wall: bool) -> None:  # noqa: FBT001
    rng = np.random.default_rng(0)
    right = count = 0
    while count < 250:
        body = hovering(yaw=rng.uniform(-3, 3), roll=rng.normal() / 15, pitch=rng.normal() / 15)
        way, side = body.yaw + rng.uniform(-0.6, 0.6), rng.uniform(-0.8, 0.8)
        x, y = rng.uniform(0.4, 1.4) * np.array([math.cos(way), math.sin(way)])
        height = rng.uniform(0.1, 0.7)
        tag = on_floor(1, x, y, yaw=9 * side)
        if wall:
            tag = on_wall(1, x, y, height, facing=way + math.pi + side)
        corners = tag_corners(body, tag)
        distance = float(np.linalg.norm(body.position - tag.position))
        if corners is None or distance > 1.5:
            continue
        count += 1
        corners += rng.normal(0, corner_std(distance, tag.size), (4, 2))
        sure = predicted(body)
        turned = rotation_from_vector(np.array([0, 0, rng.normal(0, 0.05)]))
        rolled = rotation_from_vector(np.array([0.02, 0, 0]))
        place = body.position + rng.normal(0, [0.1, 0.1, 0])
        off = replace(sure, pose=Pose(turned @ body.rotation @ rolled, place))
        (landmark,) = eye([tag]).evaluate(np.array([1]), corners[None], off).landmarks
        if landmark.fix is not None:
            error = Rotation.from_matrix(landmark.fix.pose.rotation.T @ body.rotation).magnitude()
            right += int(error < math.radians(15))
    assert right >= 0.97 * count


def test_a_camera_that_is_turned_in_its_mounting_is_understood() -> None:
    body = hovering()
    extra = rotation_from_vector(np.radians([2.0, -3.0, 4.0]))
    turned = turned_model(extra.T)
    expected = replace(predicted(body), camera_turn=extra)
    look = eye(LANDMARKS).evaluate(*table(body, LANDMARKS, turned), expected)
    assert look.fix is not None
    np.testing.assert_allclose(look.fix.pose.position, body.position, atol=1e-4)


def test_a_landmark_comes_with_what_an_estimator_needs() -> None:
    tags, corners = table(hovering(), LANDMARKS)
    first, _ = eye(LANDMARKS).evaluate(tags, corners, predicted(hovering())).landmarks
    assert first.view is not None
    np.testing.assert_allclose(first.view.rays, LENS.undistort(corners[0]))
    np.testing.assert_allclose(first.view.points.mean(axis=0), LANDMARKS[0].position, atol=1e-12)
    np.testing.assert_allclose(first.view.delay, LENS.row_delay(corners[0]))
    camera = (hovering() @ LENS.mounting).position
    expected = float(np.linalg.norm(camera - LANDMARKS[0].position))
    assert first.distance == pytest.approx(expected, rel=1e-4)
    pixels = first.view.deviation * float(LENS.magnification(first.view.rays.mean(axis=0)))
    assert pixels == pytest.approx(corner_std(expected, 0.168), rel=1e-3)


@pytest.mark.parametrize("target", [TARGET, on_wall(9, 0.9, 0.2, 0.4, 2.7)])
def test_the_error_of_a_target_agrees_with_its_covariance(target: Tag) -> None:
    rng = np.random.default_rng(1)
    body = hovering(yaw=0.2)
    expected = body.inverse() @ in_map(target)
    clean = tag_corners(body, target)
    assert clean is not None
    distance = float(np.linalg.norm((body @ LENS.mounting).position - target.position))
    squares = []
    for _ in range(150):
        noisy = clean + rng.normal(0, corner_std(distance, target.size), (4, 2))
        look = eye(LANDMARKS).evaluate(np.array([9]), noisy[None], predicted(body))
        (sighting,) = look.targets
        error = sighting.pose.position - expected.position
        squares.append(error @ np.linalg.solve(sighting.covariance, error))
        assert np.abs(error).max() < 0.1
    # The mean of 150 values of chi² with 3 degrees of freedom has a deviation of 0.2.
    assert np.mean(squares) == pytest.approx(3, abs=1.0)


def test_a_target_on_the_floor_is_not_taken_for_one_on_a_wall() -> None:
    rng = np.random.default_rng(2)
    body, expected = hovering(), hovering().inverse() @ in_map(TARGET)
    clean = tag_corners(body, TARGET)
    assert clean is not None
    for _ in range(100):
        noisy = clean + rng.normal(0, 0.3, (4, 2))
        (sighting,) = eye([]).evaluate(np.array([9]), noisy[None], predicted(body)).targets
        assert sighting.pose.rotation[2, 2] == pytest.approx(expected.rotation[2, 2], abs=0.3)
        assert sighting.pose.yaw == pytest.approx(expected.yaw, abs=0.2)


FAR = [on_floor(3, 1.9, -0.1, yaw=0.4), on_floor(4, 1.9, 0.11, yaw=0.4)]


def sure(body: Pose) -> Prediction:
    return predicted(body, deviation=0.03, yaw_deviation=0.01)


def test_tags_that_are_not_detected_are_found_by_guidance() -> None:
    body = hovering()
    look = eye([*LANDMARKS, *FAR]).analyze(paint(body, [*LANDMARKS, *FAR]), sure(body))
    assert {detection.tag for detection in look.accepted} == {1, 2}
    assert {match.tag for match in look.matches} == {3, 4}
    assert [len(view.points) for _, view in look.views] == [4, 4, 1, 1]


def test_guidance_can_be_done_without() -> None:
    body = hovering()
    unguided = ImageAnalyzer(Camera(), FAR, {}, guided_matching=False)
    assert unguided.analyze(paint(body, FAR), sure(body)) == ImageAnalysis()


def test_without_an_image_there_is_no_guided_matching() -> None:
    tags, corners = table(hovering(), LANDMARKS)
    look = eye([*LANDMARKS, *FAR]).evaluate(tags, corners, sure(hovering()))
    assert look.matches == ()
    assert len(look.views) == 2


def test_predictions_contradicted_by_all_tags_guide_no_matching() -> None:
    body, moved = hovering(), on_floor(1, 1.4, -0.9)
    image = paint(body, [LANDMARKS[0], *FAR])
    assert len(eye(FAR).analyze(image, sure(body)).matches) == 2
    look = eye([moved, *FAR]).analyze(image, sure(body))
    assert verdicts(look) == [Verdict.ELSEWHERE]
    assert look.views == ()


def test_one_wrong_number_among_right_ones_leaves_guidance_on() -> None:
    body, moved = hovering(), on_floor(1, -1.4, -0.9)
    look = eye([moved, LANDMARKS[1], *FAR]).analyze(paint(body, [*LANDMARKS, *FAR]), sure(body))
    assert verdicts(look) in (
        [Verdict.ELSEWHERE, Verdict.ACCEPTED],
        [Verdict.ACCEPTED, Verdict.ELSEWHERE],
    )
    assert len(look.matches) == 2


def test_neighbors_are_not_located_at_one_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    body = hovering()
    own, _ = eye(FAR).analyze(paint(body, FAR), sure(body)).matches
    likeness = {3: own.correlation, 4: own.correlation - 0.2}
    monkeypatch.setattr(
        "star_apriltag.vision.image_analysis.match_tag",
        lambda _image, expected, _lens: own._replace(
            tag=expected.tag.number, correlation=likeness[expected.tag.number]
        ),
    )
    look = eye(FAR).analyze(paint(body, FAR), sure(body))
    assert [match.tag for match in look.matches] == [3]
    assert [tag for tag, _, _ in look.detected] == [3]


@pytest.mark.parametrize(("under", "kept"), [(0, True), (1, False)])
def test_only_accepted_detections_hide_a_match(
    monkeypatch: pytest.MonkeyPatch, under: int, *, kept: bool
) -> None:
    body, moved = hovering(), on_floor(1, -1.4, -0.9)
    own, _ = eye(FAR).analyze(paint(body, FAR), sure(body)).matches
    hidden = tag_corners(body, LANDMARKS[under])
    assert hidden is not None
    monkeypatch.setattr(
        "star_apriltag.vision.image_analysis.match_tag",
        lambda _image, _expected, _lens: own._replace(pixel=hidden.mean(axis=0)),
    )
    look = eye([moved, LANDMARKS[1], FAR[0]]).analyze(paint(body, LANDMARKS), sure(body))
    assert {s.tag: s.verdict for s in look.landmarks} == {1: Verdict.ELSEWHERE, 2: Verdict.ACCEPTED}
    assert bool(look.matches) is kept
