"""Whether agents are on the ground or in the air where a step needs it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, Literal, TypeAlias

from star_core.mission_file.step_tree import Action, Node, Parallel, Repeat
from star_core.plugin_support.option_schema import JOIN, LEAVE
from star_core.plugin_support.specs import Problem
from star_core.registry import Registry
from star_core.scene import Scene

State: TypeAlias = Literal["ground", "air", "reserve", "removed"] | None
"""Of one agent; None if not known."""

MAX_GROUND_HEIGHT: Final = 0.05  # m: an agent that starts higher may stand on something, or fly
PHRASES: Final = {"ground": "on the ground", "air": "in the air"}
ROUNDS: Final = 2  # of a repetition: the second begins where the first ends


def problems(
    steps: Sequence[Node], scene: Scene, reserve: Iterable[int], registry: Registry
) -> Iterator[Problem]:
    """Yield steps that cannot succeed because agents are on the ground or in the air.

    After a step that may fail or end early, or a verb that does not announce it, the state of its
    agents is unknown, and nothing is reported until a verb determines it. After a step that is not
    known, this holds for every agent.

    Args:
        steps: Of the mission, in order.
        scene: The mission's scene.
        reserve: Rows of agents that are not in the mission at first.
        registry: Registry of the verbs.
    """
    starts = (agent.start[2] for agent in scene.agents)
    states: list[State] = ["ground" if z < MAX_GROUND_HEIGHT else None for z in starts]
    for row in reserve:
        states[row] = "reserve"
    yield from dict.fromkeys(_Walk(scene, states, registry).through(steps))


class _Walk:
    """A walk through the steps, with the state of every agent."""

    def __init__(self, scene: Scene, states: list[State], registry: Registry) -> None:
        self._scene = scene
        self._states = states
        self._registry = registry

    def through(self, steps: Sequence[Node], *, together: bool = True) -> Iterator[Problem]:
        """Yield what is wrong; `together` unless every agent has steps of its own."""
        for step in steps:
            match step:
                case Action(known=False):
                    self._states[:] = [None] * len(self._states)
                case Action():
                    yield from self._action(step, together=together)
                case Parallel(branches):
                    yield from self.through(branches, together=False)
                case Repeat(times, inner):
                    for _ in range(min(times, ROUNDS)):
                        yield from self.through(inner, together=together)

    def _action(self, action: Action, *, together: bool) -> Iterator[Problem]:
        """Yield what is wrong with one step, and update the states of its agents."""
        spec, states = self._registry.find("task", action.verb).offer, self._states
        rows = [row for row in action.rows if states[row] not in {"reserve", "removed"}]
        if action.verb == JOIN:
            rows = list(action.rows)
        elif together and all(states[row] == "removed" for row in action.rows):
            gone = self._scene.named(action.rows)
            message = f"{action.verb} has no agents: {gone} left the mission before"
            yield Problem(action.path, message, "agent-not-in-mission")
        wrong = []
        if spec.before is not None:
            other = "ground" if spec.before == "air" else "air"
            wrong = [row for row in rows if states[row] == other]
            if wrong:
                are = "are" if len(wrong) > 1 else "is"
                message = (
                    f"{action.verb} needs its agents {PHRASES[spec.before]}; "
                    f"{self._scene.named(wrong)} {are} {PHRASES[other]} here"
                )
                yield Problem(action.path, message, "wrong-airborne-state")
        certain = action.on_failure == "abort" and action.until is None
        for row in rows:
            if action.verb == LEAVE:
                states[row] = "removed"
            elif row in wrong:
                states[row] = None  # reported; what follows depends on the correction
            elif certain and spec.after != "same":
                states[row] = spec.after
            elif spec.after not in {spec.before, "same"} or action.on_failure == "land":
                states[row] = None
