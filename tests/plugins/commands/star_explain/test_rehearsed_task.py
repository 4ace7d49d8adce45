"""Tasks of plugins in a rehearsal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from star_core import TaskSpec, hookimpl
from tests.plugins.commands.star_explain.conftest import Rehearse

MISSION = """\
star: 1
name: hum
world: hall.yaml
swarm: {cf1: {start: [0, 0, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: none
mission: [takeoff: {height: 0.8}, hum: {}]
"""


class Hum:
    """A verb whose step returns nothing."""

    @hookimpl
    def star_tasks(self) -> Iterable[TaskSpec]:
        make: Any = lambda _scene, _rows: self  # noqa: E731 -- it is its own task
        yield TaskSpec(name="hum", summary="Hums.", make=make, options={})

    def begin(self, estimate: object, health: object) -> float:
        return 5.0

    def step(self, estimate: object, health: object) -> None: ...


def test_a_task_that_returns_nothing_fails_as_in_flight(rehearse: Rehearse) -> None:
    *_, hum = rehearse(MISSION, plugins=(Hum(),)).steps
    assert hum.outcome == "failed"
    assert hum.problem.startswith("task 'hum' (")
    assert hum.problem.endswith("returned NoneType, expected TaskOutput [contract-broken]")
