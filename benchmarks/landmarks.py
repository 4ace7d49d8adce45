"""What localisation by tags costs, and that it costs no more after a long flight.

``python benchmarks/landmarks.py`` prints a table, with ``--json`` one JSON object. Frames are timed
from image to pose, gate and filter included, on a rendered flight. The filter is timed over twenty
minutes on a circle, with corners instead of images. The peer is ``method: batch``, the original
STAR's graph of every pose, on the same flight in the same process.
"""

from __future__ import annotations

import math
import resource
import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
from printed import command_line, show

from star_apriltag.agent_estimator import CameraReport, FilterEstimator, Settings
from star_apriltag.batch import BatchEstimator
from star_apriltag.floor_odometry import FloorOdometry
from star_apriltag.joint_filter import JointFilter
from star_apriltag.vision import image_analysis
from star_core import Array, Odometry, Registry, fly, load
from star_sim.camera_sim.camera_pose import Shot
from star_sim.camera_sim.geometric import OnboardDetector

MISSIONS = Path(__file__).parents[1] / "missions"
MINUTES = 20.0
CHANGES: Mapping[str, tuple[str, ...]] = {}  # of missions
TICK = 0.05  # s
RADIUS, SPEED = 1.97, 0.28  # m and m/s: the paper's circle


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    options = command_line(__doc__).parse_args()
    factor = flown("three_eyes.yaml")["realtime_factor"]
    figures = frames() | growth() | {"three_cameras_realtime_factor": factor}
    show(figures, as_json=options.json)


def frames() -> dict[str, float]:
    """From image to pose, where a tag was found; guided matching, a tag; the floor without tags."""
    with (
        timed(FilterEstimator, "add_image", with_tags) as took,
        timed(FilterEstimator, "add_image", with_tags, time.process_time) as worked,
        timed(image_analysis, "match_tag") as matching,
        timed(FloorOdometry, "measure", lambda answer: answer is not None) as measuring,
    ):
        flown("paper_box.yaml", "localizer={use: apriltag, processes: 0}")
        ordered, cpu = sorted(took), sorted(worked)
        with timed(BatchEstimator, "_optimize") as theirs:
            flown("paper_box.yaml", "localizer={use: apriltag, method: batch, processes: 0}")
    return {
        "frame_ms_median": 1000 * statistics.median(ordered),
        "frame_ms_p95": 1000 * ordered[int(0.95 * len(ordered))],
        "frame_cpu_ms_median": 1000 * statistics.median(cpu),
        "frame_cpu_ms_p95": 1000 * cpu[int(0.95 * len(cpu))],
        "guided_match_ms_median": 1000 * statistics.median(matching),
        "floor_ms_median": 1000 * statistics.median(measuring),
        "batch_graph_at_the_end_ms": 1000 * statistics.median(theirs[-50:]),
    }


def with_tags(answer: Any) -> bool:
    """Return whether a landmark was found in an image."""
    return bool(answer and answer[0].views)


def growth() -> dict[str, float]:
    """The filter's update at the beginning and at the end of twenty minutes on a circle."""
    scene = load(MISSIONS / "paper_circle.yaml", Registry()).scene
    (agent,) = scene.agents
    assert agent.camera is not None
    detector = OnboardDetector(agent.camera, scene.world.landmarks, scene.world)
    settings = Settings(
        method="filter",
        max_tags_per_landmark=2,
        latency=0.15,
        latency_std=0.025,
        mounting_std=0.02,
        survey_std=0.015,
        survey_turn_std=0.02,
        guided_matching=True,
        floor_odometry=True,
    )
    follower = FilterEstimator(agent, scene.world.landmarks, (), settings)
    rng = np.random.default_rng(0)
    before = 0
    with timed(JointFilter, "update") as took:
        for tick in range(int(MINUTES * 60 / TICK)):
            times = tick * TICK + np.arange(1, 6) * TICK / 5
            follower.add_odometry(odometry(times, rng), np.arange(5), motors=True)
            if tick % 2 == 0:
                taken = float(times[0])
                tags, corners = detector.detect(shot(taken), rng)
                follower.add_image(CameraReport(0, taken, None, tags, corners))
            follower.advance(float(times[-1]))
            if tick == int(60 / TICK):  # all is loaded, and the track is not full yet
                before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tenth = len(took) // 10
    first, last = statistics.median(took[:tenth]), statistics.median(took[-tenth:])
    return {
        "filter_updates": len(took),
        "filter_first_tenth_ms": 1000 * first,
        "filter_last_tenth_ms": 1000 * last,
        "filter_growth": last / first,
        "memory_growth_mb": (after - before) / 1024,
    }


def shot(time: float) -> Shot:
    """Where the agent is on the circle at `time`, s."""
    angle = SPEED / RADIUS * time
    heading = angle + math.pi / 2
    ahead = np.array([math.cos(heading), math.sin(heading), 0.0])
    return Shot(
        position=np.array([RADIUS * math.cos(angle), RADIUS * math.sin(angle), 0.8]),
        attitude=np.array([0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)]),
        velocity=SPEED * ahead,
        rates=np.array([0.0, 0.0, SPEED / RADIUS]),
    )


def odometry(times: Array, rng: np.random.Generator) -> Odometry:
    """Return odometry at `times`, s, with a wrong scale, a yaw bias and noise."""
    n = len(times)
    velocity = rng.normal([1.03 * SPEED, 0.0, 0.0], 0.02, (n, 3))
    return Odometry(
        agent=np.zeros(n, np.int64),
        time=times,
        velocity=velocity,
        yaw_rate=rng.normal(SPEED / RADIUS + 0.003, 0.0025, n),
        roll=np.zeros(n),
        pitch=np.zeros(n),
        height=np.full(n, 0.8),
    )


def flown(mission: str, *changes: str) -> dict[str, Any]:
    """Fly a mission and return its summary."""
    registry = Registry()
    summary = fly(
        load(MISSIONS / mission, registry, [*changes, *CHANGES.get(mission, ())]), registry
    )
    assert summary["outcome"] == "completed", summary["reason"]
    return summary


@contextmanager
def timed(
    owner: Any,
    method: str,
    counts: Callable[[Any], bool] = lambda _answer: True,
    clock: Callable[[], float] = time.perf_counter,
) -> Iterator[list[float]]:
    """Time the calls of a function whose answers count; the list fills as it goes."""
    took: list[float] = []
    inner = getattr(owner, method)

    @wraps(inner)
    def outer(*arguments: Any, **named: Any) -> Any:
        begun = clock()
        answer = inner(*arguments, **named)
        if counts(answer):
            took.append(clock() - begun)
        return answer

    setattr(owner, method, outer)
    try:
        yield took
    finally:
        setattr(owner, method, inner)


if __name__ == "__main__":
    main()
