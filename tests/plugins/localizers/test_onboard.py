"""The localizer ``onboard``, and the receivers that the simulator has for it."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import (
    Agent,
    Array,
    Corrections,
    InputError,
    Problem,
    Registry,
    Scene,
    Telemetry,
    World,
    load,
)
from star_core.commands.main import main
from star_core.formats import check_file, code_of
from star_core.testing import scene
from star_core.toolkit import SYSTEMS, Beacon, covered, fill_defaults, received
from star_onboard import OPTIONS, check
from star_onboard.localizer import Onboard
from star_onboard.systems import INERTIAL_STD, STD, expected_std, is_covered
from star_sim import OPTIONS as SIMULATED
from star_sim import simulator_arguments
from star_sim.fusion import Fusion
from star_sim.onboard import ERRORS, nearest_surface
from star_sim.onboard import Onboard as Receivers
from star_sim.transport import Simulator
from tests.campaign import onboard
from tests.campaign.mocap import Accuracy, accuracy
from tests.plugins.localizers.conftest import report

SEED = onboard.SEED + 500
HALL = """\
star: 1
name: hall
fence: {low: [-3, -3, 0], high: [3, 3, 2.5]}
obstacles: {wall: {box: {centre: [0, 0], size: [0.2, 4]}, height: [0, 2.4]}}
base_stations: {bs1: {at: [-2.9, 0, 2], pitch_deg: 20}}
"""
FLIGHT = """\
star: 1
name: behind
world: hall.yaml
swarm: {cf1: {start: [-1, 0, 0]}}
transport: {use: sim, onboard: {system: lighthouse}}
localizer: {use: onboard, system: lighthouse}
planner: visibility
avoider: none
mission:
  - takeoff: {height: 0.8}
  - goto: {to: [1, 0, 0.8]}
  - land: {}
"""


def room(**beacons: Any) -> World:
    return replace(scene(1).world, **beacons)


STATION = Beacon("bs1", (0.0, 0.0, 2.0))  # looks along x


@pytest.mark.parametrize(
    ("point", "in_view"),
    [
        ((2.0, 0.0, 1.0), True),
        ((7.0, 0.0, 2.0), False),  # too far
        ((-1.0, 0.0, 2.0), False),  # behind it
        ((0.5, 0.0, 0.0), False),  # too far below its axis
        ((1.0, 3.0, 2.0), True),
        ((1.0, 4.5, 2.0), False),  # too far aside
    ],
)
def test_base_stations_are_received_in_their_view(point: Array, *, in_view: bool) -> None:
    points = np.array([point])
    assert received(room(base_stations=(STATION,)), SYSTEMS["lighthouse"], points) == [[in_view]]


def test_obstacles_hide_base_stations_but_not_anchors(tmp_path: Path) -> None:
    path = tmp_path / "flight.yaml"
    (tmp_path / "hall.yaml").write_text(HALL, encoding="utf-8")
    path.write_text(FLIGHT, encoding="utf-8")
    warnings = check_file(path, Registry())[1]
    outside = [line for line in warnings if "outside-coverage" in line]
    assert [line[len(f"{path}:")] for line in outside] == ["1", "1"]  # goto and landing
    assert all(" cf1 leaves " in line for line in outside)


@pytest.mark.parametrize(("anchors", "enough"), [(3, False), (4, True)])
def test_a_position_needs_four_anchors(anchors: int, *, enough: bool) -> None:
    corners = ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0), (4.0, 4.0, 2.0))
    placed = tuple(Beacon(f"a{i}", corner) for i, corner in enumerate(corners[:anchors]))
    assert covered(room(anchors=placed), "loco", np.array([[1.0, 1.0, 1.0]])) == [enough]


def test_walls_are_those_of_the_fence_and_of_obstacles() -> None:
    world = scene(1).world
    edge = world.fence.high[0]
    assert nearest_surface(world, np.array([[edge - 0.3, 0.0, 1.0]])) == pytest.approx([0.3])


def agents(n: int) -> Scene:
    return replace(scene(n), agents=tuple(Agent(f"cf{i}", (i, 0.0, 0.0)) for i in range(n)))


def telemetry(position: Array, variance: Array | None) -> Telemetry:
    moves = np.ones_like(position)
    return report(position, yaw=1.0, time=2.0, velocity=moves, position_variance=variance)


def localizer(n: int, system: str = "lighthouse") -> Onboard:
    return Onboard(agents(n), **fill_defaults({"system": system}, OPTIONS))


def test_reports_are_positions_in_the_map() -> None:
    estimate = localizer(1).locate(telemetry(np.array([[3.0, 4.0, 1.0]]), None))
    assert estimate.position.tolist() == [[3.0, 4.0, 1.0]]
    assert estimate.yaw == pytest.approx([1.0])
    assert estimate.map_from_odom.apply(np.array([[1.0, 2.0, 3.0]])).tolist() == [[1.0, 2.0, 3.0]]
    assert estimate.covariance[0, 0, 0] == pytest.approx(STD["lighthouse"].planar ** 2)
    assert estimate.valid.all()


def test_an_estimator_that_does_not_know_where_it_is_locates_no_agent() -> None:
    position = np.array([[3.0, 4.0, 1.0], [3.0, 4.0, np.nan], [5.0, 5.0, 1.0]])
    variance = np.array([[0.2**2, 0.01, 1e-4], [1e-4] * 3, [0.05**2, 0.0025, 1e-4]])
    estimate = localizer(3).locate(telemetry(position, variance))
    assert estimate.valid.tolist() == [False, False, True]
    assert estimate.position.tolist() == [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [5.0, 5.0, 1.0]]
    assert estimate.velocity.tolist() == [[0.0] * 3, [0.0] * 3, [1.0] * 3]
    assert estimate.covariance[2, 0, 0] == pytest.approx(0.05**2 + STD["lighthouse"].planar ** 2)
    assert estimate.messages == ("estimators do not know the positions of cf0, cf1",)


def test_agents_that_are_located_again_are_reported() -> None:
    plugin, position = localizer(1), np.array([[0.0, 0.0, 1.0]])
    plugin.locate(telemetry(position, np.full((1, 3), 1.0)))
    estimate = plugin.locate(telemetry(position, np.full((1, 3), 1e-4)))
    assert estimate.messages == ("estimators know the positions of cf0 again",)
    assert plugin.locate(telemetry(position, np.full((1, 3), 1e-4))).messages == ()


@pytest.mark.parametrize(
    ("flow_deck", "height_std", "std", "located"),
    [
        (True, None, STD["loco"].vertical, False),
        (False, None, INERTIAL_STD["loco"].vertical, True),
        (False, 0.3, 0.3, True),
    ],
)
def test_without_a_flow_deck_heights_err_as_the_system(
    height_std: float | None, std: float, *, flow_deck: bool, located: bool
) -> None:
    options = fill_defaults({"system": "loco", "height_std": height_std}, OPTIONS)
    plugin = Onboard(replace(agents(1), flow_deck=flow_deck), **options)
    reported = np.array([[0.05**2, 0.05**2, 0.15**2]])
    estimate = plugin.locate(telemetry(np.array([[0.0, 0.0, 1.0]]), reported))
    assert estimate.valid.tolist() == [located]
    variance = 0.15**2 if located else 0.0
    assert estimate.covariance[0, 2, 2] == pytest.approx(variance + std**2)


def findings(scene: Scene, system: str) -> list[tuple[str, bool]]:
    problems: list[Problem] = [*check(scene, system=system)]
    return [(problem.code, problem.warning) for problem in problems]


@pytest.mark.parametrize(
    ("changes", "system", "expected"),
    [
        ({"onboard_system": "poses"}, "poses", []),
        ({"onboard_system": None}, "poses", [("no-positioning", False)]),
        ({"onboard_system": "poses"}, "loco",
         [("option-conflict", False), ("no-positioning", False)]),
        ({"realtime": True}, "poses", []),
        ({"realtime": True}, "lighthouse", [("no-positioning", True)]),
    ],
)  # fmt: skip
def test_systems_that_drones_do_not_have_are_refused(
    changes: dict[str, Any], system: str, expected: list[tuple[str, bool]]
) -> None:
    assert findings(replace(scene(1), **changes), system) == expected


def test_the_system_that_the_drones_have_is_named() -> None:
    problem, *_ = check(replace(scene(1), onboard_system="lighthouse"), system="poses")
    assert problem.path == ("system",)
    assert problem.message.endswith("; write localizer: {use: onboard, system: lighthouse}")


@pytest.mark.parametrize("realtime", [True, False])
@pytest.mark.parametrize(
    ("yaw_deg", "turned"), [(90, True), (-170, True), (5, False), (360, False)]
)
def test_loco_requires_starts_along_the_x_axis(
    yaw_deg: float, *, turned: bool, realtime: bool
) -> None:
    room = load(onboard.LOCO, Registry()).scene
    agents = tuple(replace(agent, yaw=math.radians(yaw_deg)) for agent in room.agents)
    changed = replace(room, agents=agents, realtime=realtime)
    assert findings(changed, "loco") == ([("option-conflict", not realtime)] if turned else [])


def test_localizers_that_expect_odometry_are_refused() -> None:
    with pytest.raises(InputError) as caught:
        load(onboard.LIGHTHOUSE, Registry(), ["localizer=flow"])
    assert [code_of(problem) for problem in caught.value.problems] == ["option-conflict"]


def test_expected_errors_are_those_of_the_system() -> None:
    path = np.zeros((4, 1, 3))
    for flies, table in ((scene(1), STD), (replace(scene(1), flow_deck=False), INERTIAL_STD)):
        std = expected_std(flies, np.arange(4.0), path, path[..., 0], system="loco")
        assert std.tolist() == [[table["loco"].planar]] * 4
    assert is_covered(scene(1), path[:, 0], system="poses").all()


def test_simulated_errors_are_those_of_the_table() -> None:
    """Positions of two base stations err by their geometry, of one by three times as much."""
    drones = np.zeros(1, [("position", "f8", 3), ("attitude", "f8", 4)])
    drones["position"], drones["attitude"][:, 3] = (1.0, 0.0, 1.5), 1.0
    other = Beacon("bs2", (0.0, 0.5, 2.0))
    errors: dict[int, list[float]] = {1: [], 2: []}
    for seed in range(200):
        for stations in ((STATION,), (STATION, other)):
            swarm = replace(scene(1), seed=seed, world=room(base_stations=stations))
            fixes = Receivers(swarm, Fusion(1), system="lighthouse").measured(drones, 0.0)
            assert isinstance(fixes, Corrections)
            errors[len(stations)] += (fixes.position - drones["position"]).ravel().tolist()
    bias = ERRORS["lighthouse"].bias
    assert np.std(errors[1]) == pytest.approx(3 * bias, rel=0.1)
    assert np.std(errors[2]) == pytest.approx(bias / np.sqrt(2), rel=0.1)


@cache
def flown_by(system: str) -> Accuracy:
    """Fly there and back by a system."""
    path, changes = onboard.SYSTEMS[system]
    steps = (
        "[takeoff: {height: 0.8}, goto: {by: [1.5, 0, 0]}, goto: {by: [-0.5, 0, 0.3]}, land: {}]"
    )
    return accuracy(SEED, (*changes, f"mission={steps}"), path)


@pytest.mark.parametrize(
    ("system", "most", "along_z"),
    [
        ("lighthouse", 0.05, 0.02),
        pytest.param("loco", 0.16, 0.02, marks=pytest.mark.extended),
        pytest.param("poses", 0.02, 0.02, marks=pytest.mark.extended),
        pytest.param("lighthouse, no Flow deck", 0.05, 0.04, marks=pytest.mark.extended),
        ("loco, no Flow deck", 0.2, 0.16),
        pytest.param("poses, no Flow deck", 0.02, 0.01, marks=pytest.mark.extended),
    ],
)
def test_flights_are_as_accurate_as_the_system(system: str, most: float, along_z: float) -> None:
    flight = flown_by(system)
    assert flight.rms <= most
    assert flight.along_z <= along_z


def test_heights_by_loco_alone_are_its_worst_axis() -> None:
    flight = flown_by("loco, no Flow deck")
    planar = (flight.rms**2 - flight.along_z**2) / 2  # m², along x or y
    assert flight.along_z**2 > 2 * planar


@pytest.mark.extended
@pytest.mark.parametrize("name", onboard.HOLDS)
def test_what_receivers_lose_is_noticed(name: str) -> None:
    assert onboard.HOLDS[name](SEED)


URIS = [f"swarm.cf{row}.uri=udp://127.0.0.1:{19850 + row}" for row in (1, 2)]


@pytest.mark.parametrize(
    ("changes", "flow_deck"),
    [
        ((), True),
        (onboard.NO_FLOW_DECK, False),
        (("transport={use: radio}", *URIS), True),
        (("transport={use: radio, flow_deck: false}", *URIS), False),
    ],
)
def test_missions_declare_drones_without_flow_decks(
    changes: tuple[str, ...], *, flow_deck: bool
) -> None:
    flies = load(onboard.LOCO, Registry(), changes).scene
    assert (flies.flow_deck, flies.heights_above_surface) == (flow_deck, flow_deck)


def test_accelerometers_without_a_flow_deck_are_scaled_at_rest() -> None:
    with_deck, without = (
        Simulator(
            agents(2),
            **simulator_arguments(
                **fill_defaults({"onboard": {"system": "poses", "flow_deck": deck}}, SIMULATED)
            ),
        ).drones
        for deck in (True, False)
    )
    expected = with_deck["accelerometer_bias"] * [1, 1, 1 / 6]
    assert without["accelerometer_bias"] == pytest.approx(expected)
    assert not without["flow_share"].any()
    assert not without["ranger_share"].any()


def test_the_plan_names_base_stations(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", str(onboard.LIGHTHOUSE)]) == 0
    assert "  stations   bs1, bs2\n" in capsys.readouterr().out
