"""Start positions of steps: whether they are those of the rehearsal, and how exactly."""

from __future__ import annotations

from star_core import Mission, Registry, TaskSpec
from star_core.toolkit import Action, Rehearsal, RehearsedStep, actions


class Origins:
    """What is known about where agents begin their steps.

    Attributes:
        rounds: Rounds of each step in the rehearsal, by the `id` of the step.
        uncertain: Of each step of the mission, the rows of agents that may then be elsewhere than
            in the rehearsal: after a step that a condition ended, or of unknown duration.
    """

    def __init__(self, mission: Mission, registry: Registry, rehearsal: Rehearsal) -> None:
        self._scene = mission.scene
        self._registry = registry
        self._named: dict[int, bool] = {}  # by the `id` of the step, as the next
        self._begins: dict[int, tuple[bool, bool]] = {}
        self._unsure: set[int] = set()  # rows, as the next
        self._anchored: set[int] = set()
        self.rounds: dict[int, list[RehearsedStep]] = {}
        for step in rehearsal.steps:
            self.rounds.setdefault(id(step.action), []).append(step)
        self.uncertain: list[frozenset[int]] = []
        for node in mission.steps:
            inner = [step for action in actions([node]) for step in self.rounds.get(id(action), ())]
            for step in sorted(inner, key=lambda step: step.begun):
                self._note(step)
            self.uncertain.append(frozenset(self._unsure))
        for reaction in mission.reactions:
            for action in actions(reaction.steps):
                for step in self.rounds.get(id(action), ()):
                    self._note(step)

    def certain(self, action: Action) -> bool:
        """Return whether the agents of a step begin it where the rehearsal has them."""
        return self._begins[id(action)][0]

    def anchored(self, action: Action) -> bool:
        """Return whether the agents of a step begin it at goals that the mission names.

        Otherwise they begin it above where they took off, which is known less exactly. So is where
        another agent is that the step's options name.
        """
        return self._begins[id(action)][1]

    def is_relative(self, step: RehearsedStep) -> bool:
        """Return whether a step leads to goals that depend on where it begins."""
        spec = self._spec(step.action)
        return (spec.before, spec.after) == ("air", "air") and not self._has_named_goals(step)

    def _note(self, step: RehearsedStep) -> None:
        """Note where the agents of a step begin it, and end it."""
        action, rows = step.action, set(step.rows)
        beside_another = any(name in action.options.values() for name in self._scene.names)
        anchored = self._anchored.issuperset(rows) and not beside_another
        begin = self._unsure.isdisjoint(rows), anchored
        self._begins.setdefault(id(action), begin)
        spec, named = self._spec(action), self._has_named_goals(step)
        sure = step.duration is not None and action.until is None
        if not sure:
            self._unsure |= rows
        elif named:
            self._unsure -= rows
            self._anchored |= rows
        if not (named and sure) and "ground" in {spec.before, spec.after}:
            self._anchored -= rows

    def _has_named_goals(self, step: RehearsedStep) -> bool:
        """Return whether the check of a mission knows the goals of a step."""
        action = step.action
        if id(action) not in self._named:
            spec = self._spec(action)
            self._named[id(action)] = spec.goals is not None and any(
                spec.goals(self._scene, step.rows, **action.options)
            )
        return self._named[id(action)]

    def _spec(self, action: Action) -> TaskSpec:
        spec: TaskSpec = self._registry.find("task", action.verb).offer
        return spec
