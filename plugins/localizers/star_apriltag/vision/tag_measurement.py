"""One image, or the tags found in one, turned into poses that were checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from star_apriltag.vision.body_pose import Fix, View
from star_apriltag.vision.detector import Detector
from star_apriltag.vision.expected_tags import Foresight
from star_apriltag.vision.gate import MOST_ODDS, Verdict
from star_apriltag.vision.guided_matching import Match, find
from star_apriltag.vision.landmark import Place, SeenLandmark, seen_landmark, together
from star_apriltag.vision.prediction import Prediction
from star_apriltag.vision.target import SeenTarget, seen_target
from star_core import Array, Camera, CameraModel, Image, Rows, Tag


@dataclass(frozen=True, slots=True)
class Look:
    """What one image says.

    Attributes:
        landmarks: Tags of the map.
        targets: Tags to be found.
        strangers: Numbers of tags that are neither.
        fix: Of the body, from all landmarks that were accepted; None if none was.
        other: Of the body, from all landmarks that were rejected for being elsewhere, if they fit
            together: where the agent is if the prediction is wrong.
        guided: Tags of the map that were not detected, but found where they were expected.
    """

    landmarks: tuple[SeenLandmark, ...] = ()
    targets: tuple[SeenTarget, ...] = ()
    strangers: tuple[int, ...] = ()
    fix: Fix | None = None
    other: Fix | None = None
    guided: tuple[Match, ...] = ()

    @property
    def accepted(self) -> tuple[SeenLandmark, ...]:
        """The landmarks that were detected and are to be believed."""
        return tuple(seen for seen in self.landmarks if seen.verdict is Verdict.ACCEPTED)

    @property
    def doubtful(self) -> bool:
        """Whether all that was detected of the map speaks against the prediction."""
        elsewhere = any(seen.verdict is Verdict.ELSEWHERE for seen in self.landmarks)
        return elsewhere and not self.accepted

    @property
    def views(self) -> tuple[View, ...]:
        """All that is to be believed, as measurements."""
        detected = tuple(seen.view for seen in self.accepted if seen.view is not None)
        return detected + tuple(match.view for match in self.guided)


class Eye:
    """Looks at the images of one camera.

    Args:
        camera: As the scene has it.
        known_tags: Tags whose places are known, by their numbers.
        targets: Sizes of the tags to be found, m, by their numbers.
        guided: Whether to look where known tags should be that were not detected.

    Attributes:
        lens: Of the camera.
        detector: What finds tags in its images.
    """

    def __init__(
        self,
        camera: Camera,
        known_tags: Mapping[int, Tag],
        targets: Mapping[int, float],
        *,
        guided: bool = True,
    ) -> None:
        self.lens = CameraModel(camera)
        self.detector = Detector(self.lens)
        self._places = {number: Place(tag) for number, tag in known_tags.items()}
        self._sizes = dict(targets)
        self._foresight = Foresight(self.lens, list(self._places.values()) if guided else [])

    def look(self, image: Image, prediction: Prediction) -> Look:
        """Return what an image says.

        Args:
            image: As the lens shows it.
            prediction: Of the body when the image was taken.

        Raises:
            ValueError: It is no grey image of the camera's size.
        """
        found = self.detector.detect(image)
        look = self.consider(found.tag, found.corners, prediction)
        if look.doubtful:
            return look
        expected = self._foresight.expect(prediction, passed_over=found.tag.tolist())
        matches = [find(image, one, self.lens) for one in expected]
        return replace(look, guided=tuple(match for match in matches if match is not None))

    def consider(self, tags: Rows, corners: Array, prediction: Prediction) -> Look:
        """Return what the tags found in an image say.

        Args:
            tags: (K,) their numbers.
            corners: (K, 4, 2) px: bottom left, bottom right, top right and top left of each.
            prediction: Of the body when the image was taken.
        """
        landmarks: list[SeenLandmark] = []
        targets: list[SeenTarget] = []
        strangers: list[int] = []
        rays = self.lens.undistort(corners)
        for tag, pixels, seen in zip(tags.tolist(), corners, rays, strict=True):
            if tag in self._places:
                place = self._places[tag]
                landmarks.append(seen_landmark(place, pixels, seen, self.lens, prediction))
            elif tag in self._sizes:
                size = self._sizes[tag]
                target = seen_target(tag, size, pixels, seen, self.lens, prediction)
                targets.extend([] if target is None else [target])
            else:
                strangers.append(tag)
        elsewhere = [s for s in landmarks if s.verdict is Verdict.ELSEWHERE]
        other = together(elsewhere, self.lens, prediction)
        fix = self._agreed(landmarks, prediction)
        return Look(
            landmarks=tuple(landmarks),
            targets=tuple(targets),
            strangers=tuple(strangers),
            fix=fix,
            other=other if other is not None and other.misfit <= MOST_ODDS else None,
        )

    def _agreed(self, landmarks: list[SeenLandmark], prediction: Prediction) -> Fix | None:
        """Return the fix of the landmarks that were accepted.

        Tags of one sheet are too near to each other for the gate to know a wrong number by its
        place. While they do not fit together, the most surprising one is turned away.
        """
        while True:
            rows = [i for i, s in enumerate(landmarks) if s.verdict is Verdict.ACCEPTED]
            fix = together([landmarks[i] for i in rows], self.lens, prediction)
            if len(rows) <= 1 or (fix is not None and fix.misfit <= MOST_ODDS):
                return fix
            worst = max(rows, key=lambda i: landmarks[i].surprise)
            landmarks[worst] = replace(landmarks[worst], verdict=Verdict.AT_ODDS)
