"""What ``star check`` reports of a mission that can be flown all the same, and of plugins."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from star_core import (
    AvoiderSpec,
    LocalizerSpec,
    Mission,
    PlannerSpec,
    Problem,
    Registry,
    TransportSpec,
    hookimpl,
    load,
)
from star_core.errors import InputError, PluginError
from star_core.formats import check_file
from tests.commands import position_and_code

pytestmark = pytest.mark.ideal_world

MISSION = """\
star: 1
name: hop
world: room.yaml
limits: {separation: 0.2}
swarm:
  cf1: {start: [-1, 0, 0]}
  cf2: {start: [1, 0, 0]}
transport: sim
localizer: flow
planner: straight
avoider: {use: orca, radius: 0.2}
mission:
  - takeoff: {height: 0.8}
  - goto: {agents: cf1, to: [-1, 1, 0.8]}
"""
WORLD = "star: 1\nname: room\nfence: {low: [-3, -3, 0], high: [3, 3, 2]}\n"
WALL = "obstacles:\n  wall: {box: {centre: [-1, 0.5], size: [1, 0.1]}, height: [0, 2]}\n"
TABLE = "obstacles:\n  table: {box: {centre: [-1, 0], size: [1, 1]}, height: [0, 0.4]}\n"


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def warnings(
    old: str = "", new: str = "", world: str = "", *plugins: object, changes: tuple[str, ...] = ()
) -> list[str]:
    """The warnings about the mission with one of its texts replaced, and with changes."""
    Path("hop.yaml").write_text(MISSION.replace(old, new) if old else MISSION)
    Path("room.yaml").write_text(WORLD + world)
    text, messages = check_file(Path("hop.yaml"), Registry(*plugins), changes)
    assert text == "hop.yaml: 'hop' can be flown, with 2 agents"
    return list(messages)


def test_a_good_mission_has_no_warnings() -> None:
    assert warnings() == []


def test_a_start_in_the_air_is_a_warning() -> None:
    (problem,) = warnings("[-1, 0, 0]", "[-1, 0, 0.5]")
    assert position_and_code(problem) == "hop.yaml:6:16 [start-in-air]"


@pytest.mark.parametrize("height", [0.47, 0.5])
def test_a_start_on_an_obstacle_is_none(height: float) -> None:
    assert warnings("[-1, 0, 0]", f"[-1, 0, {height}]", TABLE) == []


def test_a_separation_larger_than_the_avoiders_is_a_warning() -> None:
    (problem,) = warnings("separation: 0.2", "separation: 0.9")
    assert position_and_code(problem) == "hop.yaml:4:22 [option-conflict]"


def test_obstacles_in_the_way_are_warnings_if_the_avoider_avoids() -> None:
    (problem,) = warnings(world=WALL)
    assert position_and_code(problem) == "hop.yaml:14:11 [path-blocked]"
    assert "warning: obstacle 'wall' is in the way of cf1 at [-1." in problem


def test_a_planner_that_avoids_obstacles_is_not_blocked() -> None:
    assert "[path-blocked]" not in "".join(warnings("straight", "visibility", WALL))


RANGER = ("transport.profile=realistic",)
LOW_WALL = WALL.replace("[0, 2]", "[0, 0.6]")


def test_ranger_flights_over_an_obstacle_are_warnings() -> None:
    assert warnings(world=LOW_WALL, changes=RANGER) == [
        "hop.yaml:14:11: warning: cf1 flies over obstacle 'wall' at [-1.00, 0.46, 0.80], from "
        "where a ranger measures its height: at the edge it sinks for a moment; fly 0.30 m above "
        "it or more [over-obstacle]"
    ]


def test_a_flight_close_beside_a_low_obstacle_may_lead_over_it() -> None:
    def beside(x: float, planner: str = "straight") -> str:
        world = LOW_WALL.replace("[-1, 0.5]", f"[{x}, 0.5]")
        return "".join(warnings("straight", planner, world, changes=RANGER))

    assert "cf1 may fly over obstacle 'wall'" in beside(-0.35, "visibility")
    assert beside(-0.2, "visibility") == ""
    assert "cf1 may fly over obstacle 'wall'" in beside(-0.2)  # pushed aside by others
    assert beside(0.0) == ""


def test_flights_high_enough_above_an_obstacle_are_none() -> None:
    low = WALL.replace("[0, 2]", "[0, 0.5]")
    assert warnings(world=low, changes=RANGER) == []


NEVER_MADE: Any = object


class Heights:
    """Offers a localizer that corrects heights, or takes what is below for the floor."""

    def __init__(self, *, corrects: bool) -> None:
        self._corrects = corrects

    @hookimpl
    def star_localizers(self) -> Iterable[LocalizerSpec]:
        yield LocalizerSpec(
            name="ranger", summary="Maps.", make=NEVER_MADE, corrects_heights=self._corrects
        )


def test_without_corrected_heights_every_edge_is_one() -> None:
    changes, trusts = (*RANGER, "localizer=ranger"), Heights(corrects=False)
    (over,) = warnings("", "", LOW_WALL, trusts, changes=changes)
    assert over.endswith("it climbs by 0.60 m [over-obstacle]")
    edges = warnings("[-1, 0, 0]", "[-1, 0, 0.5]", TABLE, trusts, changes=changes)
    assert "cf1 flies over the floor" in edges[-1]
    assert edges[-1].endswith("it sinks by 0.40 m [over-obstacle]")


def test_a_planner_leads_over_an_obstacle_or_around_it() -> None:
    changes = (*RANGER, "planner=visibility")
    low, wide = WALL.replace("[0, 2]", "[0, 1.3]"), "size: [4, 0.1]"
    assert "[over-obstacle]" not in "".join(warnings(world=low, changes=changes))  # around
    *_, over = warnings(world=low.replace("size: [1, 0.1]", wide), changes=changes)
    assert "cf1 flies over obstacle 'wall'" in over
    assert over.endswith("[over-obstacle]")


class Silent:
    """Offers a transport, a planner and an avoider that declare nothing of what they can do."""

    @hookimpl
    def star_transports(self) -> Iterable[TransportSpec]:
        yield TransportSpec(name="link", summary="A link.", make=NEVER_MADE)

    @hookimpl
    def star_planners(self) -> Iterable[PlannerSpec]:
        yield PlannerSpec(name="way", summary="A planner.", make=NEVER_MADE)

    @hookimpl
    def star_avoiders(self) -> Iterable[AvoiderSpec]:
        yield AvoiderSpec(name="dodge", summary="An avoider.", make=NEVER_MADE)


def test_undeclared_obstacle_avoidance_is_none() -> None:
    with pytest.raises(InputError, match=r"obstacle 'wall' is in the way .*\[path-blocked\]"):
        warnings("", "", WALL, Silent(), changes=("planner=way", "avoider=dodge"))


def test_undeclared_heights_are_above_the_surface() -> None:
    messages = warnings("", "", LOW_WALL, Silent(), changes=("transport=link",))
    assert "[over-obstacle]" in "".join(messages)


def test_an_undeclared_transport_is_in_real_time() -> None:
    Path("hop.yaml").write_text(MISSION)
    Path("room.yaml").write_text(WORLD)
    mission = load(Path("hop.yaml"), Registry(Silent()), ["transport=link"])
    assert mission.scene.realtime
    assert not mission.scene.exact_odometry
    assert not mission.scene.measures_positions


@pytest.mark.parametrize("changes", [(), (*RANGER, "transport.noise=false")])
def test_obstacles_below_map_referenced_heights_are_not_reported(changes: tuple[str]) -> None:
    assert warnings(world=LOW_WALL, changes=changes) == []


def test_height_correcting_localizers_may_cross_obstacles() -> None:
    changes = (*RANGER, "localizer=ranger")
    assert warnings("", "", LOW_WALL, Heights(corrects=True), changes=changes) == []


class TooLong:
    """Refuses missions of more than a number of steps, and warns of all others."""

    def __init__(self, most: int) -> None:
        self._most = most

    @hookimpl
    def star_check(self, mission: Mission) -> Iterator[Problem]:
        steps = len(mission.steps)
        yield Problem(("mission",), f"{steps} steps", "too-long", warning=steps <= self._most)


def test_plugins_can_check_missions() -> None:
    (problem,) = warnings("", "", "", TooLong(2))
    assert position_and_code(problem) == "hop.yaml:12:1 [too-long]"
    with pytest.raises(InputError) as error:
        warnings("", "", "", TooLong(1))
    assert position_and_code(str(error.value)) == "hop.yaml:12:1 [too-long]"


def test_a_check_that_raises_names_its_plugin() -> None:
    class Broken:
        @hookimpl
        def star_check(self, mission: Mission) -> Iterator[Problem]:
            raise ValueError(mission.name)

    with pytest.raises(PluginError, match=r"star_check of .*Broken.*: ValueError: hop"):
        warnings("", "", "", Broken())
