"""State machines of the phases of agents and mission, as two tables of transitions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from typing import Final

import numpy as np
from transitions import Machine

from star_core.messages.arrays import Mask, Rows, frozen
from star_core.messages.state import AgentPhase, among
from star_core.messages.telemetry import EMERGENCIES, Supervisor, emergency

_P = AgentPhase
AGENT_TABLE: Final = (
    {"trigger": "take_off", "source": [_P.GROUNDED, _P.LANDED], "dest": _P.TAKING_OFF},
    {"trigger": "climbed", "source": _P.TAKING_OFF, "dest": _P.FLYING},
    {"trigger": "lose", "source": [_P.TAKING_OFF, _P.FLYING], "dest": _P.LOST},
    {"trigger": "find", "source": _P.LOST, "dest": _P.FLYING},
    {"trigger": "land", "source": [_P.TAKING_OFF, _P.FLYING, _P.LOST], "dest": _P.LANDING},
    {"trigger": "down", "source": _P.LANDING, "dest": _P.LANDED},
    {"trigger": "fail", "source": "*", "dest": _P.EMERGENCY},
)


class MissionPhase(StrEnum):
    """Phase of a mission; the last three are its outcomes."""

    IDLE = "idle"
    FLYING = "flying"
    LANDING = "landing"
    COMPLETED = "completed"
    FAILED = "failed"
    ABORTED = "aborted"


_M = MissionPhase
MISSION_TABLE: Final = (
    {"trigger": "start", "source": _M.IDLE, "dest": _M.FLYING},
    {"trigger": "land", "source": _M.FLYING, "dest": _M.LANDING},
    {"trigger": "complete", "source": _M.LANDING, "dest": _M.COMPLETED},
    {"trigger": "fail", "source": "*", "dest": _M.FAILED},
    {"trigger": "abort", "source": "*", "dest": _M.ABORTED},
)

FALLEN: Final = int(sum(EMERGENCIES))


class _Agent:
    """Model of the state machine of agents."""

    state: AgentPhase


class _Mission:
    """Model of the state machine of missions."""

    state: MissionPhase


class Phases:
    """The phases of every agent, by `AGENT_TABLE`, and of the mission, by `MISSION_TABLE`.

    >>> phases = Phases(("cf1", "cf2"))
    >>> phases.fire("take_off", [1])
    >>> phases.of_agents().tolist()
    [0, 1]
    >>> list(phases.changes())
    [('cf2', 'taking_off')]
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._agents = [_Agent() for _ in names]
        self._mission = _Mission()
        self._changes: list[tuple[str | None, str]] = []
        for models, states, table, first in (  # the models refer to the machines
            (self._agents, AgentPhase, AGENT_TABLE, AgentPhase.GROUNDED),
            ([self._mission], MissionPhase, MISSION_TABLE, MissionPhase.IDLE),
        ):
            Machine(
                model=models,
                states=states,
                transitions=list(table),
                initial=first,
                auto_transitions=False,
                ignore_invalid_triggers=True,
            )
        self._now = frozen(np.zeros(len(names), np.int64))
        self._among: dict[tuple[AgentPhase, ...], Mask] = {}  # of the present phases
        self._causes = [""] * len(names)  # of emergencies
        self._last_inputs: tuple[bytes, ...] = ()

    @property
    def mission(self) -> MissionPhase:
        """The phase of the mission."""
        return self._mission.state

    def of_agents(self) -> Rows:
        """Return the `AgentPhase` of each agent: (N,)."""
        return self._now

    def among(self, *phases: AgentPhase) -> Mask:
        """Return which agents are in one of some phases: (N,), read-only."""
        mask = self._among.get(phases)
        if mask is None:
            mask = self._among[phases] = frozen(among(self._now, *phases))
        return mask

    def describe(self, row: int) -> str:
        """Return the phase of an agent, and the cause of an emergency if it is known."""
        phase = AgentPhase(int(self._now[row]))
        cause = self._causes[row] if phase is AgentPhase.EMERGENCY else ""
        return f"{phase.name.lower()}: {cause}" if cause else phase.name.lower()

    def fire(self, trigger: str, rows: Iterable[int] | Rows, cause: str = "") -> None:
        """Apply a trigger to some agents; those whose phase has no transition for it keep it.

        Args:
            trigger: Of `AGENT_TABLE`.
            rows: The agents.
            cause: Of an emergency.
        """
        for row in rows:
            model = self._agents[row]
            self._causes[row] = cause or self._causes[row]
            model.trigger(trigger)  # type: ignore[attr-defined]  # made by the machine
            if model.state != self._now[row]:
                now = self._now.copy()  # earlier results of `of_agents` must not change
                now[row] = model.state
                self._now, self._among = frozen(now), {}
                self._changes.append((self._names[row], model.state.name.lower()))

    def fire_mission(self, trigger: str) -> None:
        """Apply a trigger to the mission."""
        before = self._mission.state
        self._mission.trigger(trigger)  # type: ignore[attr-defined]  # made by the machine
        if self._mission.state is not before:
            self._changes.append((None, str(self._mission.state)))

    def observe(self, state: Rows, heard: Mask, located: Mask, settled: Mask) -> None:
        """Update the phases by telemetry.

        Args:
            state: (N,) bits of `Supervisor`; used where `heard`.
            heard: (N,) whether the agent has been heard recently.
            located: (N,) whether its estimate is valid.
            settled: (N,) whether a climb has come to rest once the commander has finished it.
        """
        inputs = (
            state.tobytes(), heard.tobytes(), located.tobytes(), settled.tobytes(),
            self._now.tobytes(),
        )  # fmt: skip
        if inputs == self._last_inputs:
            return  # no transition is possible
        self._last_inputs = inputs
        finished = heard & (state & int(Supervisor.COMMANDER_FINISHED) != 0)
        flying = state & int(Supervisor.FLYING) != 0
        fallen = heard & (state & FALLEN != 0) & ~self.among(_P.EMERGENCY)
        for row in np.flatnonzero(fallen).tolist():
            self.fire("fail", [row], emergency(int(state[row])))
        climbed = finished & flying & settled
        self.fire("climbed", np.flatnonzero(climbed & self.among(_P.TAKING_OFF)))
        self.fire("down", np.flatnonzero(finished & ~flying & self.among(_P.LANDING)))
        fit = heard & located
        self.fire("lose", np.flatnonzero(~fit & self.among(_P.TAKING_OFF, _P.FLYING)))
        self.fire("find", np.flatnonzero(fit & flying & self.among(_P.LOST)))

    def changes(self) -> Iterator[tuple[str | None, str]]:
        """Yield each change of phase since the last call: agent (None: the mission) and phase."""
        changes, self._changes = self._changes, []
        yield from changes
