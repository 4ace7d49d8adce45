"""What localisation by tags costs, and that it costs no more after a long flight.

``python benchmarks/landmarks.py`` prints a table, with ``--json`` one JSON object. Frames are timed
from image to pose, gate and graph included, on a rendered flight. The graph is timed over twenty
minutes of a flight whose cameras send corners. The peer is ``method: batch``, the original STAR's
graph of every pose, on the same images in the same process.
"""

from __future__ import annotations

import json
import resource
import statistics
import sys
import time
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

from star_apriltag.batch import Batched
from star_apriltag.follower import Smoothed
from star_apriltag.smoother import Smoother
from star_core import Registry, fly, load

MISSIONS = Path(__file__).parents[1] / "missions"
LAPS = 28  # of the circle at 0.28 m/s: twenty minutes


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    found = {**frames(), **growth(), **three_cameras()}
    if "--json" in sys.argv[1:]:
        print(json.dumps(found))
        return
    for name, value in found.items():
        print(f"{name:36} {value:10.4g}")


def frames() -> dict[str, float]:
    """From image to pose, for images in which a tag was found."""
    took = timed(Smoothed, "look", lambda answer: bool(answer and answer[0].accepted))
    flown("paper_box.yaml")
    theirs = timed(Batched, "look")
    flown("paper_box.yaml", "localizer={use: apriltag, method: batch}")
    ordered = sorted(took)
    return {
        "frame_ms_median": 1000 * statistics.median(took),
        "frame_ms_p95": 1000 * ordered[int(0.95 * len(ordered))],
        "batch_last_ms_median": 1000 * statistics.median(theirs[-50:]),
    }


def growth() -> dict[str, float]:
    """The graph's update at the beginning and at the end of twenty minutes."""
    took = timed(Smoother, "add")
    flown("paper_circle.yaml", "transport.camera.mode=geometric")  # so that all is loaded
    took.clear()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    summary = flown(
        "paper_circle.yaml", "transport.camera.mode=geometric", f"mission.1.follow.laps={LAPS}",
        "mission.1.follow.timeout=2000",
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tenth = len(took) // 10
    first, last = statistics.median(took[:tenth]), statistics.median(took[-tenth:])
    return {
        "flight_s": summary["flight_time_s"],
        "graph_first_tenth_ms": 1000 * first,
        "graph_last_tenth_ms": 1000 * last,
        "graph_growth": last / first,
        "memory_growth_mb": (after - before) / 1024,
    }


def three_cameras() -> dict[str, float]:
    """How much faster than real time three cameras at 10 Hz are flown."""
    return {"three_cameras_realtime_factor": flown("three_eyes.yaml")["realtime_factor"]}


def flown(mission: str, *changes: str) -> dict[str, Any]:
    """Fly a mission and return its summary."""
    registry = Registry()
    summary = fly(load(MISSIONS / mission, registry, changes), registry)
    assert summary["outcome"] == "completed", summary["reason"]
    return summary


def timed(
    owner: type, method: str, counts: Callable[[Any], bool] = lambda _answer: True
) -> list[float]:
    """Time every further call of a method whose answer counts; the list fills as it is called."""
    took: list[float] = []
    inner = getattr(owner, method)

    @wraps(inner)
    def outer(*arguments: Any, **named: Any) -> Any:
        begun = time.perf_counter()
        answer = inner(*arguments, **named)
        if counts(answer):
            took.append(time.perf_counter() - begun)
        return answer

    setattr(owner, method, outer)
    return took


if __name__ == "__main__":
    main()
