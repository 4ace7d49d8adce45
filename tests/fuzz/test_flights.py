"""Random missions are the same for a seed and valid; each verdict on a flight can be reached."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import Registry, load
from tests.fuzz.ground_truth import Witness, beside, judged
from tests.fuzz.random_missions import random_mission

WORLD = {
    "fence": {"low": [-2, -2, 0], "high": [2, 2, 2]},
    "obstacles": {"post": {"cylinder": {"centre": [1.5, 0], "radius": 0.1}, "height": [0, 2]}},
}
DONE: dict[str, Any] = {"outcome": "completed", "reason": "", "steps": []}


def draw_of(seed: int) -> random.Random:
    return random.Random(seed)  # noqa: S311 -- no secret


def test_a_seed_draws_the_same_mission_with_all_its_files() -> None:
    drawn = [random_mission(draw_of(3)) for _ in range(2)]
    assert drawn[0] == drawn[1] != random_mission(draw_of(4))


def verbs(step: Any) -> Iterator[str]:
    """Yield the verbs of a step and of the steps in it."""
    if isinstance(step, list):
        for inner in step:
            yield from verbs(inner)
    elif isinstance(step, dict):
        ((verb, options),) = step.items()
        yield verb
        if verb == "parallel":
            yield from verbs(options)
        elif verb in {"repeat", "each"}:
            yield from verbs(options["steps"])
        elif verb == "if":
            yield from verbs([*options["then"], *options.get("else", [])])


def test_random_missions_have_every_verb_and_all_plugins() -> None:
    drawn = [random_mission(draw_of(seed)).mission for seed in range(70)]
    assert {verb for mission in drawn for verb in verbs(mission["mission"])} == {
        *("takeoff", "land", "goto", "hold", "wait", "formation", "follow", "search", "join"),
        *("leave", "parallel", "repeat", "each", "include", "if"),
    }
    assert {mission["avoider"] for mission in drawn} == {"orca", "voronoi", "potential"}
    assert {mission["planner"] for mission in drawn} == {"straight", "visibility"}
    assert {2, 12} <= {len(mission["swarm"]) for mission in drawn}


def test_random_missions_can_be_loaded(tmp_path: Path) -> None:
    registry = Registry()
    for seed in range(6):
        load(random_mission(draw_of(seed)).write(tmp_path), registry)


def witness() -> Witness:
    """Return two drones that hover at 1 m for a minute, 1 m apart and at their goals, and land."""
    ticks = 20 * 60
    height = np.concatenate([np.ones(ticks), np.linspace(1.0, 0.0, 100)])
    return Witness(
        names=("cf1", "cf2"),
        time=list(np.arange(len(height)) / 20),
        position=[np.array([[x, 0.0, z] for x in (0.0, 1.0)]) for z in height],
        climb=[np.full(2, 0.0 if z == 1.0 else -0.2) for z in height],
        away=[np.zeros(2) for _ in height],
    )


def collide(flight: Witness) -> None:
    flight.position[500][1, 0] = 0.1


def touch(flight: Witness) -> None:
    flight.position[500][1, 0] = 1.35


def leave(flight: Witness) -> None:
    flight.position[500][0, 1] = -2.3


def fall(flight: Witness) -> None:
    flight.climb[500][0] = -1.5


def land_hard(flight: Witness) -> None:
    flight.climb[-1][1] = -1.1


def stay_up(flight: Witness) -> None:
    flight.position[-1][1, 2] = 0.8


def stand_still(flight: Witness) -> None:
    for away in flight.away:
        away[1] = 0.5


@pytest.mark.parametrize(
    ("breaks", "verdict"),
    [
        (collide, "collision: cf1, cf2, 0.10 m at 25.0 s"),
        (touch, "contact: cf2, 0.05 m from post at 25.0 s"),
        (leave, "fence: cf1, 0.30 m outside at 25.0 s"),
        (fall, "fall: cf1, 1.50 m/s at 25.0 s"),
        (land_hard, "impact: cf2, 1.10 m/s at 65.0 s"),
        (stay_up, "aloft: cf2, at 0.80 m after the end"),
        (stand_still, "deadlock: cf2, from 0.0 s on"),
    ],
)
def test_every_verdict_can_be_reached(breaks: Callable[[Witness], None], verdict: str) -> None:
    flight = witness()
    assert judged(flight, WORLD, DONE) == []
    breaks(flight)
    assert judged(flight, WORLD, DONE) == [verdict]


def test_a_mission_that_is_not_completed_is_a_defect() -> None:
    failed = {**DONE, "outcome": "failed", "reason": "goto times out"}
    assert judged(witness(), WORLD, failed) == ["failed: goto times out"]
    step = {"location": "m.yaml:3:5", "verb": "goto", "outcome": "failure"}
    (defect,) = judged(witness(), WORLD, {**DONE, "steps": [step]})
    assert defect.startswith("step m.yaml:3:5 goto")


def test_a_concave_polygon_has_its_notch_outside() -> None:
    notched = {"polygon": [[0, 0], [2, 0], [1, 0.5], [0, 2]]}
    assert beside(notched, np.array([[0.5, 0.5], [1.5, 1.0]])).round(3).tolist() == [0.0, 0.671]
