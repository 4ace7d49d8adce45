"""Assignment of agents to targets."""

from __future__ import annotations

import subprocess
import sys
from itertools import combinations, permutations
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import AgentPhase, Array
from star_core.testing import estimate, health, scene
from star_verbs import step_agents
from star_verbs.step_agents import StepAgents, assign
from tests.plugins.tasks.conftest import make

seeds = st.integers(0, 2**32 - 1)


def swarm(seed: int, agents: int, targets: int, *, level: bool = False) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    starts, goals = rng.uniform(-2, 2, (agents, 3)), rng.uniform(-2, 2, (targets, 3))
    if level:
        starts[:, 2] = goals[:, 2] = 0.8
    return starts, goals


@given(seeds, st.integers(1, 4), st.integers(0, 2))
def test_no_other_assignment_flies_less_in_all(seed: int, agents: int, spare: int) -> None:
    starts, goals = swarm(seed, agents, agents + spare)
    flown = np.linalg.norm(starts - goals[assign(starts, goals)], axis=1).sum()
    least = min(
        np.linalg.norm(starts - goals[list(choice)], axis=1).sum()
        for choice in permutations(range(agents + spare), agents)
    )
    assert flown == pytest.approx(least, abs=1e-4)


@given(seeds, st.integers(2, 8))
def test_no_two_ways_cross(seed: int, agents: int) -> None:
    starts, goals = swarm(seed, agents, agents, level=True)
    ends = np.hstack([starts[:, :2], goals[assign(starts, goals)][:, :2]])
    for (a, b), (c, d) in combinations(ends.reshape(-1, 2, 2), 2):
        assert not (_side(a, b, c) * _side(a, b, d) < 0 and _side(c, d, a) * _side(c, d, b) < 0)


@given(seeds, st.integers(1, 6))
def test_no_target_is_assigned_twice(seed: int, agents: int) -> None:
    starts, goals = swarm(seed, agents, agents + 2)
    assert len(set(assign(starts, goals).tolist())) == agents


def test_agents_in_a_row_move_up_and_do_not_overtake() -> None:
    starts = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert assign(starts, starts + np.array([1.0, 0, 0])).tolist() == [0, 1, 2]


@given(st.permutations(range(8)))
def test_agents_at_the_targets_stay(order: list[int]) -> None:
    target = np.random.default_rng(0).uniform(-5, 5, (8, 3))
    assert assign(target[order], target).tolist() == order


@given(seeds, st.integers(1, 4), st.integers(0, 2))
def test_few_agents_are_assigned_as_scipy_assigns_them(seed: int, agents: int, spare: int) -> None:
    starts, goals = swarm(seed, agents, agents + spare)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(step_agents, "MAX_ENUMERATED", 6)
        enumerated = assign(starts, goals)
        patch.setattr(step_agents, "MAX_ENUMERATED", 0)
        assert assign(starts, goals).tolist() == enumerated.tolist()


def test_a_larger_swarm_imports_scipy_before_it_flies() -> None:
    ask = (
        "import sys; from star_verbs.step_agents import import_assignment\n"
        "import_assignment(4); few = 'scipy.optimize' in sys.modules\n"
        "import_assignment(5); assert (few, 'scipy.optimize' in sys.modules) == (False, True)"
    )
    subprocess.run([sys.executable, "-c", ask], check=True)


@pytest.mark.parametrize(
    ("verb", "options"),
    [("formation", {"shape": "grid", "centre": [0, 0, 0.8]}), ("goto", {"to": [0, 0, 0.8]})],
)
def test_a_stuck_agent_and_one_before_it_exchange(verb: str, options: dict[str, Any]) -> None:
    room = scene(6)
    task = make(verb, room, tuple(range(6)), **options, spacing=0.6)
    slots = np.array([[x, y, 0.8] for y in (0.3, -0.3) for x in (-0.6, 0.0, 0.6)])
    if verb == "goto":
        task.begin(estimate(np.array(slots)), health(6, AgentPhase.FLYING))
        slots = task.step(estimate(slots), health(6)).goals.position
    last = int(np.argmax(slots[:, 0]))
    before = int(np.argsort(np.linalg.norm(slots - slots[last], axis=1))[1])
    stuck = slots.copy()
    stuck[last] += 1.45 * (slots[before] - slots[last])  # beyond the one that it could follow
    task.begin(estimate(slots), health(6, AgentPhase.FLYING))
    goals = [
        task.step(estimate(stuck, time=time), health(6)).goals.position
        for time in np.arange(0.0, 4.0, 0.5)
    ]
    exchanged = slots.copy()
    exchanged[[last, before]] = slots[[before, last]]
    assert goals[0].tolist() == slots.tolist()
    assert goals[-1].tolist() == exchanged.tolist()


def test_agents_do_not_exchange_for_a_replacement_on_its_way() -> None:
    agents, point = StepAgents(scene(3), (0, 1)), np.array([[0.0, 0, 1], [1, 0, 1]])
    position = np.array([[0.0, 0, 1], [1.3, 0, 1], [-2.0, 0, 1]])
    agents.exchanged(estimate(position), point, 0.1)
    agents.replace(1, 2)
    for time in np.arange(0.5, 5.0, 0.5):
        position[2, 0] += 0.25
        assert agents.exchanged(estimate(position, time=time), point, 0.1) is point


def _side(a: Array, b: Array, c: Array) -> float:
    """On which side of the line from a to b the point c lies, as an area."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
