"""The slots of a mission, and the agents assigned to them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from star_core.messages.arrays import Mask, frozen
from star_core.world.scene import Scene


@dataclass(frozen=True, slots=True)
class Team:
    """The agents of a step.

    Attributes:
        holders: The row of the agent assigned to each of the step's slots.
        rows: Their rows.
        members: (N,) whether an agent is one of them.
        label: Their names or their group's, for messages.
    """

    holders: Mapping[int, int]
    rows: tuple[int, ...]
    members: Mask
    label: str

    @classmethod
    def of(cls, holders: Mapping[int, int], scene: Scene) -> Team:
        """Return the agents assigned to some slots."""
        rows = tuple(holders.values())
        members = np.zeros(len(scene.agents), np.bool_)
        members[list(rows)] = True
        return cls(holders, rows, members, scene.label(rows))


class Assignments:
    """The slots of a mission and the agents assigned to them.

    A slot is numbered by the row of its first agent; steps are for slots. Another agent may be
    assigned to it, or none.

    Args:
        n: Number of agents.
        reserve: Rows of the agents that are in no step until they replace another or join.

    Attributes:
        retired: Slots that stay empty.
        version: Increases with each change.
        removed: (N,) agents that have left the mission without reserves and cannot join it.
        unassigned: (N,) agents that are not in the mission.
    """

    removed: Mask
    unassigned: Mask

    def __init__(self, n: int, reserve: Iterable[int] = ()) -> None:
        self._holder = list(range(n))
        self._vacant = set(reserve)
        self.retired = set(reserve)
        self._program: dict[int, int] = {}
        self.version = 0
        self._changed()

    def holders(self, slots: Iterable[int], program: int | None = None) -> dict[int, int]:
        """Return the row of the agent of each of some slots, without the empty ones.

        Args:
            slots: Any slots.
            program: Only those whose agents follow this one: 0, the steps of the mission, or the
                number of a reaction, from 1, or, above those, of what the flight's program gave;
                None for all.
        """
        return {
            slot: self._holder[slot]
            for slot in slots
            if slot not in self._vacant and program in {None, self.program(slot)}
        }

    def program(self, slot: int) -> int:
        """Return the program that the agent of a slot follows."""
        return self._program.get(slot, 0)

    def take_over(self, slots: Iterable[int], program: int) -> None:
        """Let the agents of some slots follow a reaction from now on."""
        self._program |= dict.fromkeys(slots, program)
        self._changed()

    def slot(self, row: int) -> int | None:
        """Return the slot of an agent; None if it is not in the mission."""
        for slot, holder in enumerate(self._holder):
            if holder == row and slot not in self._vacant:
                return slot
        return None

    def vacancies(self) -> list[int]:
        """Return the empty slots that an agent should be assigned to."""
        return sorted(self._vacant - self.retired)

    def vacate(self, rows: Iterable[int], *, retire: bool = False) -> None:
        """Take agents out of the mission; with `retire`, their slots stay empty."""
        for row in rows:
            if (slot := self.slot(row)) is not None:
                self._vacant.add(slot)
                if retire:
                    self.retired.add(slot)
                self._changed()

    def assign(self, slot: int, row: int) -> None:
        """Assign an agent to a slot, replacing its present one."""
        self._holder[slot] = row
        self._vacant.discard(slot)
        self.retired.discard(slot)
        self._changed()

    def _changed(self) -> None:
        self.version += 1
        removed = np.zeros(len(self._holder), np.bool_)
        removed[self.vacancies()] = True
        unassigned = np.ones(len(self._holder), np.bool_)
        unassigned[list(self.holders(range(len(self._holder))).values())] = False
        self.removed, self.unassigned = frozen(removed), frozen(unassigned)
