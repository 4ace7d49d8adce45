"""Tags in one image: detected, matched, located and checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from star_apriltag.vision.body_pose import MAX_JOINT_MISFIT, Fix, Prediction, Verdict, View
from star_apriltag.vision.detector import Detector
from star_apriltag.vision.expected_tags import ExpectedTags
from star_apriltag.vision.guided_matching import TagMatch, match_tag, without_overlaps
from star_apriltag.vision.tag_poses import (
    MapTag,
    SeenLandmark,
    SeenTarget,
    joint_fix,
    seen_landmark,
    seen_target,
)
from star_core import Array, Camera, Image, Rows, Tag
from star_core.toolkit import CameraModel


@dataclass(frozen=True, slots=True)
class ImageAnalysis:
    """Result of one image."""

    landmarks: tuple[SeenLandmark, ...] = ()  # tags of the map
    targets: tuple[SeenTarget, ...] = ()  # tags of targets
    fix: Fix | None = None  # of the body, from all accepted landmarks; None if there is none
    # of the body, from all landmarks that were rejected as far from the prediction, if they are
    # consistent: the agent's pose if the prediction is wrong
    other: Fix | None = None
    # tags of the map that were not detected, but found where they were expected
    matches: tuple[TagMatch, ...] = ()
    # all tags: number, (4, 2) corners, px, and why it is not used, or an empty text
    detected: tuple[tuple[int, Array, str], ...] = ()

    def with_verdict(self, verdict: Verdict) -> tuple[SeenLandmark, ...]:
        """Return the landmarks with a verdict."""
        return tuple(landmark for landmark in self.landmarks if landmark.verdict is verdict)

    @property
    def accepted(self) -> tuple[SeenLandmark, ...]:
        """The landmarks that were detected and accepted."""
        return self.with_verdict(Verdict.ACCEPTED)

    @property
    def views(self) -> tuple[tuple[int, View], ...]:
        """All accepted measurements, with the numbers of their tags."""
        detected = tuple(
            (landmark.tag, landmark.view) for landmark in self.accepted if landmark.view is not None
        )
        return detected + tuple((match.tag, match.view) for match in self.matches)


class ImageAnalyzer:
    """Analyzes the images of one camera.

    Args:
        camera: As the scene has it.
        landmarks: Tags of the map.
        targets: Sizes of the tags of targets, m, by their numbers.
        guided_matching: Whether to search expected tags that were not detected.

    Attributes:
        lens: Of the camera.
    """

    def __init__(
        self,
        camera: Camera,
        landmarks: Iterable[Tag],
        targets: Mapping[int, float],
        *,
        guided_matching: bool,
    ) -> None:
        self.lens = CameraModel(camera)
        self._detector = Detector(self.lens)
        self._map = {tag.id: MapTag(tag) for tag in landmarks}
        self._sizes = dict(targets)
        self._expected = ExpectedTags(
            self.lens, list(self._map.values()) if guided_matching else []
        )

    def analyze(self, image: Image, prediction: Prediction) -> ImageAnalysis:
        """Detect tags in an image and evaluate them.

        Raises:
            ValueError: It is no gray image of the camera's size.
        """
        detections = self._detector.detect(image)
        analysis = self.evaluate(detections.tag, detections.corners, prediction)
        if analysis.with_verdict(Verdict.ELSEWHERE) and not analysis.accepted:
            return analysis  # all tags contradict the prediction, which cannot guide then
        expected = self._expected.expect(prediction, exclude=detections.tag.tolist())
        searched = (match_tag(image, tag, self.lens) for tag in expected)
        candidates = [match for match in searched if match is not None]
        accepted = (corners for _, corners, rejected in analysis.detected if not rejected)
        matches = without_overlaps(candidates, accepted)
        matched = tuple((match.tag, match.corners, "") for match in matches)
        return replace(analysis, matches=matches, detected=analysis.detected + matched)

    def evaluate(self, tags: Rows, corners: Array, prediction: Prediction) -> ImageAnalysis:
        """Evaluate tags by their (K,) numbers and (K, 4, 2) corners, px."""
        landmarks: list[SeenLandmark] = []
        targets: list[SeenTarget] = []
        rays = self.lens.undistort(corners)
        rejected = ["neither a landmark nor a target"] * len(tags)
        rows: list[int] = []  # of the landmarks
        for i, (tag, pixels, tag_rays) in enumerate(zip(tags.tolist(), corners, rays, strict=True)):
            if tag in self._map:
                rows.append(i)
                landmarks.append(
                    seen_landmark(self._map[tag], pixels, tag_rays, self.lens, prediction)
                )
            elif tag in self._sizes:
                size = self._sizes[tag]
                target = seen_target(tag, size, pixels, tag_rays, self.lens, prediction)
                targets.extend([] if target is None else [target])
                rejected[i] = str(Verdict.UNSOLVED) if target is None else ""
        elsewhere = [s for s in landmarks if s.verdict is Verdict.ELSEWHERE]
        other = joint_fix(elsewhere, self.lens, prediction)
        fix = self._consistent(landmarks, prediction)
        for i, landmark in zip(rows, landmarks, strict=True):
            accepted = landmark.verdict is Verdict.ACCEPTED
            rejected[i] = "" if accepted else str(landmark.verdict)
        return ImageAnalysis(
            landmarks=tuple(landmarks),
            targets=tuple(targets),
            fix=fix,
            other=other if other is not None and other.misfit <= MAX_JOINT_MISFIT else None,
            detected=tuple(zip(tags.tolist(), corners, rejected, strict=True)),
        )

    def _consistent(self, landmarks: list[SeenLandmark], prediction: Prediction) -> Fix | None:
        """Return the fix of the accepted landmarks.

        Tags of one sheet are too close for the gate to detect a wrong number by its position. While
        they are inconsistent, the most surprising one is rejected.
        """
        while True:
            rows = [i for i, s in enumerate(landmarks) if s.verdict is Verdict.ACCEPTED]
            fix = joint_fix([landmarks[i] for i in rows], self.lens, prediction)
            if len(rows) <= 1 or (fix is not None and fix.misfit <= MAX_JOINT_MISFIT):
                return fix
            worst = max(rows, key=lambda i: landmarks[i].surprise)
            landmarks[worst] = replace(landmarks[worst], verdict=Verdict.INCONSISTENT)
