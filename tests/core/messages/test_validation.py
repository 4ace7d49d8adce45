"""What the core holds every answer to, message by message."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from star_core import (
    Avoider,
    ContractError,
    Detections,
    Estimate,
    Paths,
    Plan,
    Scene,
    Setpoint,
    Sightings,
    Telemetry,
    Transform,
    Transport,
)
from star_core.pipeline import renewed
from star_core.plugin_support.guard import require_methods, require_signature
from star_core.plugin_support.outputs import (
    checked_estimate,
    checked_plan,
    checked_setpoint,
    checked_telemetry,
)
from star_core.testing import estimate

TWO = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
HOLE = np.array([[0.0, 0.0, 1.0], [1.0, np.nan, np.inf]])
GOOD = estimate(TWO)
BOTH, FIRST = np.array([True, True]), np.array([True, False])
GAP = np.array([0.0, np.nan])
SETPOINT = Setpoint(velocity=TWO, yaw=np.zeros(2), active=BOTH)
TELEMETRY = Telemetry(
    time=0.0,
    position=TWO,
    velocity=TWO,
    attitude=np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)),
    battery=np.full(2, 4.0),
    state=np.zeros(2, np.int64),
    age=np.zeros(2),
)
PLAN = Plan(SETPOINT, Paths(np.zeros(0, np.int64), np.zeros((0, 3))), ~BOTH)


def refused(check: Callable[..., Any], *arguments: Any) -> str:
    with pytest.raises(ContractError) as caught:
        check(*arguments)
    return str(caught.value)


def test_a_part_that_lacks_methods_is_refused_with_their_names() -> None:
    class Half:
        def connect(self) -> None: ...
        def wait(self, until: float) -> None: ...
        def receive(self) -> None: ...
        def send(self, setpoint: Setpoint) -> None: ...

    assert (
        refused(require_methods, Half(), Transport)
        == "Half has no command(), correct(), truth(), close() [contract-broken]"
    )


def test_a_part_keeps_its_contract_by_its_shape() -> None:
    class Mine:
        def avoid(self, estimate: Estimate, planned: Setpoint) -> Setpoint:
            return planned

    require_methods(Mine(), Avoider)


def line_of(function: Callable[..., Any]) -> str:
    return f"{__file__}:{function.__code__.co_firstlineno}"


def test_methods_with_wrong_arguments_are_reported_with_the_line() -> None:
    class Short:
        def avoid(self, estimate: Estimate) -> None: ...

    assert refused(require_methods, Short(), Avoider) == (
        "avoid(estimate) cannot be called as avoid(estimate, planned): "
        f"too many positional arguments ({line_of(Short.avoid)}) [contract-broken]"
    )


def test_functions_with_wrong_options_are_reported_with_the_line() -> None:
    def make(scene: Scene, gain: float) -> None: ...

    assert refused(require_signature, make, "make", ("scene",), {"share": 0.8}) == (
        "make(scene, gain) cannot be called as make(scene, share=...): "
        f"missing a required argument: 'gain' ({line_of(make)}) [contract-broken]"
    )


@pytest.mark.parametrize("function", [max, int, lambda *_, **__: None])
def test_compatible_or_unknown_signatures_are_accepted(function: Callable[..., Any]) -> None:
    require_signature(function, "make", ("scene",))


@pytest.mark.parametrize(
    ("changes", "value"),
    [
        ({"position": HOLE}, "position of row 1 is [1.0, nan, inf]"),
        ({"velocity": HOLE}, "velocity of row 1 is [1.0, nan, inf]"),
        ({"yaw": [np.nan, 0.0]}, "yaw of row 0 is nan"),
        ({"covariance": np.full((2, 3, 3), np.nan)}, "covariance of row 0 is "),
        (
            {"map_from_odom": Transform(np.array([0.0, np.inf]), TWO)},
            "map_from_odom.yaw of row 1 is inf",
        ),
        (
            {"map_from_odom": Transform(np.zeros(2), HOLE)},
            "map_from_odom.translation of row 1 is [1.0, nan, inf]",
        ),
    ],
)
def test_an_estimate_that_is_valid_and_no_number_is_refused(
    changes: dict[str, Any], value: str
) -> None:
    assert refused(checked_estimate, replace(GOOD, **changes), 2).startswith(f"Estimate.{value}")


def test_an_estimate_may_hold_anything_where_it_is_not_valid() -> None:
    hole = replace(GOOD, position=HOLE, velocity=HOLE, yaw=GAP, valid=FIRST)
    assert checked_estimate(hole, 2) is hole


def test_an_estimate_of_another_swarm_is_refused() -> None:
    message = "every field of Estimate has 2 rows, expected 3, one per agent [contract-broken]"
    assert refused(checked_estimate, GOOD, 3) == message


@pytest.mark.parametrize(
    ("changes", "value"),
    [
        ({"velocity": HOLE}, "velocity of row 1 is [1.0, nan, inf]"),
        ({"yaw": [0.0, np.inf]}, "yaw of row 1 is inf"),
    ],
)
def test_a_setpoint_that_is_active_and_no_number_is_refused(
    changes: dict[str, Any], value: str
) -> None:
    hole = replace(SETPOINT, **changes)
    for message in (
        refused(checked_setpoint, hole, 2),
        refused(checked_plan, replace(PLAN, setpoint=hole), 2),
    ):
        assert message == f"Setpoint.{value}, expected numbers [contract-broken]"


def test_a_setpoint_may_hold_anything_where_it_is_not_active() -> None:
    hole = replace(SETPOINT, velocity=HOLE, yaw=GAP, active=FIRST)
    assert checked_setpoint(hole, 2) is hole
    assert checked_plan(replace(PLAN, setpoint=hole), 2).setpoint is hole


def test_a_setpoint_or_a_plan_of_another_swarm_is_refused() -> None:
    message = "every field of Setpoint has 2 rows, expected 1, one per agent [contract-broken]"
    assert refused(checked_setpoint, SETPOINT, 1) == message
    assert refused(checked_plan, PLAN, 1) == message


@pytest.mark.parametrize("agent", [-1, 2])
def test_a_path_of_an_agent_that_there_is_not_is_refused(agent: int) -> None:
    nowhere = replace(PLAN, paths=Paths(np.array([agent]), np.zeros((1, 3))))
    message = f"Plan.paths.agent is [{agent}], expected rows below 2 [contract-broken]"
    assert refused(checked_plan, nowhere, 2) == message


@pytest.mark.parametrize(
    ("check", "kind"),
    [(checked_estimate, "Estimate"), (checked_plan, "Plan"), (checked_setpoint, "Setpoint")],
)
def test_no_answer_is_refused(check: Callable[..., Any], kind: str) -> None:
    assert refused(check, None, 2) == f"returned NoneType, expected {kind} [contract-broken]"


def test_sightings_are_of_agents_that_exist() -> None:
    far = Sightings(
        agent=np.array([7]),
        tag=np.array([1]),
        time=np.zeros(1),
        position=np.zeros((1, 3)),
        yaw=np.zeros(1),
        covariance=np.zeros((1, 3, 3)),
    )
    message = refused(checked_estimate, replace(GOOD, sightings=far), 2)
    assert message == "Estimate.sightings.agent is [7], expected rows below 2 [contract-broken]"


@pytest.mark.parametrize(
    ("agent", "corner", "message"),
    [
        (2, 0.0, "Estimate.detections.agent is [2], expected rows below 2 [contract-broken]"),
        (1, np.nan, "Estimate.detections.corners of row 0 is"),
    ],
)
def test_detections_are_of_agents_that_exist_at_pixels(
    agent: int, corner: float, message: str
) -> None:
    corners, time = np.full((1, 4, 2), corner), np.zeros(1)
    bad = Detections(np.array([agent]), np.array([7]), corners, time, time)
    assert refused(checked_estimate, replace(GOOD, detections=bad), 2).startswith(message)


def test_reused_estimates_do_not_repeat_their_detections() -> None:
    time = np.zeros(1)
    detections = Detections(np.array([1]), np.array([7]), np.zeros((1, 4, 2)), time, time)
    assert not len(renewed(replace(GOOD, detections=detections), 0.1).detections.tag)


def test_detections_have_a_reason_each_if_any() -> None:
    none, time = np.zeros(2, np.int64), np.zeros(2)
    with pytest.raises(ContractError, match="rejected"):
        Detections(none, none, np.zeros((2, 4, 2)), time, time, ("far",))


def test_detections_of_several_tables_are_merged_in_order() -> None:
    time = np.array([1.0, np.nan])
    rows = np.arange(2)
    first = Detections(rows, rows, np.zeros((2, 4, 2)), time, time + 1)
    second = Detections(rows + 2, rows, np.ones((2, 4, 2)), time, np.full(2, 3.0), ("far", ""))
    both = Detections.merged([Detections.none(), first, second])
    assert both.agent.tolist() == [0, 1, 2, 3]
    assert both.rejected == ("", "", "far", "")
    assert both.time[[0, 2, 3]].tolist() == [1.0, 1.0, 3.0]
    assert both.of(both.agent == 2).rejected == ("far",)
    assert not len(Detections.merged([]).of(np.zeros(0, np.int64)).tag)


def test_reasons_of_a_plan_are_a_map() -> None:
    odd: Any = ["walled in"]
    error = refused(checked_plan, replace(PLAN, reasons=odd), 2)
    assert (
        error == "Plan.reasons is ['walled in'], expected a map from row to text [contract-broken]"
    )


def test_a_report_has_a_time() -> None:
    message = refused(checked_telemetry, replace(TELEMETRY, time=np.nan), 2)
    assert message == "Telemetry.time is nan, expected a number [contract-broken]"


@pytest.mark.parametrize("name", ["odometry", "frames", "detections"])
def test_what_is_reported_is_of_agents_that_exist(name: str) -> None:
    tables: dict[str, Any] = {name: SimpleNamespace(agent=np.array([0, 2]))}
    message = refused(checked_telemetry, replace(TELEMETRY, **tables), 2)
    assert message == f"Telemetry.{name}.agent is [0, 2], expected rows below 2 [contract-broken]"
