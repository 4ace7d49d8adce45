"""When a search begins and ends, and what finders do."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import AgentPhase, Order, PluginError, Status
from tests.plugins.tasks.star_search.conftest import PERIOD, hall, search

RED, BLUE = (1.2, 1.2), (-1.3, 1.0)
TWO = {"red": RED, "blue": BLUE}


def test_a_search_without_flying_agents_fails() -> None:
    flown = search(hall(2), phase=AgentPhase.GROUNDED)
    assert (flown.status, flown.reason) == (Status.FAILURE, "no agent flies; take off first")


def test_it_waits_until_all_that_fly_are_located() -> None:
    def meddle(time: float, _task: Any, scouts: Any) -> None:
        scouts.valid = np.array([True, time >= 2.0])

    flown = search(hall(2), meddle=meddle, longest=4.0)
    assert len(flown.goal) * PERIOD == pytest.approx(2.0, abs=PERIOD)  # s, from 2 s on
    assert np.isfinite(flown.goal[0]).all()


def test_its_time_out_does_not_wait_for_a_location() -> None:
    def meddle(_time: float, _task: Any, scouts: Any) -> None:
        scouts.valid = np.array([False])

    assert 30.0 < search(hall(1), meddle=meddle, longest=0.2).limit < 600.0


@pytest.mark.parametrize(
    ("options", "expected"),
    [({"targets": 1}, 1), ({}, 2), ({"targets": 0}, None)],
    ids=["enough", "all of the world", "none wanted"],
)
def test_targets_end_it_or_it_covers_the_area(
    options: dict[str, Any], expected: int | None
) -> None:
    flown = search(hall(2, targets=TWO), **options)
    assert flown.status is Status.SUCCESS
    assert (flown.space.coverage.fraction >= 0.99) is (expected is None)
    assert expected in {None, (flown.finder >= 0).sum()}


@pytest.mark.parametrize("options", [{}, {"targets": 1}])
def test_search_succeeds_when_every_scout_landed_at_a_target(options: dict[str, Any]) -> None:
    flown = search(hall(1, targets={"red": RED}), on_found="land", **options)
    assert flown.status is Status.SUCCESS
    assert flown.phase.tolist() == [AgentPhase.LANDED]


def test_targets_may_be_named() -> None:
    flown = search(hall(2, targets=TWO), targets=["red"])
    assert flown.status is Status.SUCCESS
    assert flown.finder[0] >= 0


def test_a_covered_area_ends_it_before_all_targets_are_found() -> None:
    hidden = {"hidden": (0.0, 0.0)}  # under the block
    flown = search(hall(2, targets=hidden), targets=1)
    assert flown.status is Status.SUCCESS
    assert flown.finder.tolist() == [-1]


def test_a_smaller_coverage_is_reached_sooner() -> None:
    half, whole = search(hall(2), coverage=0.5), search(hall(2), coverage=0.99)
    assert half.time < 0.6 * whole.time
    assert half.space.coverage.fraction >= 0.5


def test_the_finder_lands_at_its_target_and_the_others_search_on() -> None:
    flown = search(hall(2, targets={"red": RED}), on_found="land", targets=0)
    ((_, command),) = flown.commands
    assert flown.status is Status.SUCCESS
    assert command.order is Order.LAND
    assert command.agent.tolist() == flown.finder.tolist()
    assert flown.phase[flown.finder[0]] == AgentPhase.LANDED
    assert (flown.phase == AgentPhase.LANDED).sum() == 1
    assert flown.position[-1][flown.finder[0], :2] == pytest.approx(RED, abs=0.2)
    assert flown.space.coverage.fraction >= 0.99


def test_search_fails_if_all_landed_before_full_coverage() -> None:
    flown = search(hall(1, targets=TWO), on_found="land")
    assert flown.status is Status.FAILURE
    assert flown.reason.startswith("no agent remains to search; ")
    assert flown.reason.endswith("% of the area was seen")


def test_a_target_too_near_to_an_obstacle_is_landed_beside() -> None:
    flown = search(hall(1, targets={"red": (0.55, 0.0)}), targets=1, on_found="land")
    x, y = flown.position[-1][0, :2]
    assert flown.status is Status.SUCCESS
    assert np.hypot(x - 0.55, y) < 0.35
    assert x >= 0.65


def test_the_finder_hovers_at_its_target_to_the_end() -> None:
    flown = search(hall(2, targets={"red": RED}), on_found="hover", targets=0)
    assert flown.status is Status.SUCCESS
    assert flown.commands == []
    assert flown.position[-1][flown.finder[0], :2] == pytest.approx(RED, abs=0.2)


def test_marking_agents_hover_over_the_target_then_search_on() -> None:
    flown = search(hall(1, targets=TWO), on_found="mark", mark_duration=4.0)
    assert flown.status is Status.SUCCESS
    for target in TWO.values():
        near = np.linalg.norm(flown.track[:, 0, :2] - target, axis=1) <= 0.2
        assert near.sum() * PERIOD >= 4.0


def test_a_target_is_marked_before_enough_targets_end_it() -> None:
    quick = search(hall(1, targets={"red": RED}), targets=1)
    marked = search(hall(1, targets={"red": RED}), targets=1, on_found="mark", mark_duration=4.0)
    assert marked.time >= quick.time + 4.0


def test_no_agent_lands_at_a_target_that_was_found_before() -> None:
    def meddle(_time: float, _task: Any, scouts: Any) -> None:
        scouts.finder = np.array([0])

    flown = search(hall(2, targets={"red": RED}), on_found="land", targets=0, meddle=meddle)
    assert flown.commands == []
    assert flown.space.coverage.fraction >= 0.99


def test_two_agents_that_land_at_one_target_land_apart() -> None:
    near = {"red": RED, "blue": (1.2, 1.0)}
    flown = search(hall(3, targets=near), on_found="land", targets=0)
    down = np.flatnonzero(flown.phase == AgentPhase.LANDED)
    positions = flown.position[-1][down, :2]
    if len(down) == 2:
        assert np.linalg.norm(positions[0] - positions[1]) >= 0.4
    assert flown.status is Status.SUCCESS


def test_the_search_does_not_wait_for_a_finder_that_left() -> None:
    def meddle(_time: float, task: Any, scouts: Any) -> None:
        if (scouts.finder >= 0).any() and len(task._rows) == 2:
            task.on_agents_removed(tuple(row for row in (0, 1) if row != scouts.finder[0]))
            scouts.phase = np.where(np.arange(2) == scouts.finder[0], 6, scouts.phase)

    flown = search(hall(2, targets={"red": RED}), on_found="land", targets=0, meddle=meddle)
    assert flown.status is Status.SUCCESS
    assert flown.space.coverage.fraction >= 0.99


@pytest.mark.parametrize("then", ["mark", "hover"])
def test_an_agent_that_takes_over_from_a_finder_makes_its_visit(then: str) -> None:
    swapped: list[float] = []

    def meddle(time: float, task: Any, scouts: Any) -> None:
        if (scouts.finder >= 0).any() and not swapped:
            swapped.append(time)
            task.on_agent_replaced(int(scouts.finder[0]), 2)

    room = hall(3, targets={"red": RED})
    flown = search(room, rows=(0, 1), on_found=then, targets=1, meddle=meddle)
    assert flown.status is Status.SUCCESS
    assert np.hypot(*(flown.track[-1, 2, :2] - RED)) < 0.3


def test_a_replacement_without_a_camera_does_not_search() -> None:
    def meddle(time: float, task: Any, _scouts: Any) -> None:
        if time == 5.0:
            task.on_agent_replaced(1, 2)

    room = hall(3)
    blind = replace(room, agents=(*room.agents[:2], replace(room.agents[2], camera=None)))
    flown = search(blind, rows=(0, 1), meddle=meddle)
    assert flown.status is Status.SUCCESS
    assert np.isnan(np.array(flown.goal)[:, 2]).all()


def test_a_search_without_cameras_is_refused() -> None:
    with pytest.raises(PluginError, match="no agent with a camera remains to search: cf1, cf2"):
        search(hall(2, camera=None))


def test_visits_to_targets_have_time() -> None:
    room = hall(2, targets=TWO)
    plain = search(room, longest=0.1).limit
    assert search(room, longest=0.1, on_found="mark", mark_duration=10.0).limit >= plain + 3 * 20.0
    assert search(room, longest=0.1, on_found="land").limit > plain
