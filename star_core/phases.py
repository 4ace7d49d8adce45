"""The phases a mission and its agents go through, as two tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from typing import Final

import numpy as np
from transitions import Machine

from star_core.messages.arrays import Mask, Rows
from star_core.messages.state import AgentPhase, among
from star_core.messages.telemetry import Supervisor

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
    """Where a mission stands; the last three are how it can end."""

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

FALLEN: Final = int(Supervisor.TUMBLED | Supervisor.LOCKED | Supervisor.CRASHED)


class _Agent:
    """What the machine of the agents keeps the states of."""

    state: AgentPhase


class _Mission:
    """What the machine of the mission keeps the state of."""

    state: MissionPhase


class Phases:
    """Keeps every agent to `AGENT_TABLE` and the mission to `MISSION_TABLE`.

    >>> phases = Phases(("cf1", "cf2"))
    >>> phases.fire("take_off", [1])
    >>> phases.of_agents().tolist()
    [0, 1]
    >>> list(phases.changes())
    [('cf2', 'taking_off')]

    Args:
        names: Name of the agent in each row.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._agents = [_Agent() for _ in names]
        self._mission = _Mission()
        self._changes: list[tuple[str | None, str]] = []
        for models, states, table, first in (  # the machines are held by what they move
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
        self._now = np.zeros(len(names), np.int64)
        self._seen: tuple[bytes, ...] = ()

    @property
    def mission(self) -> MissionPhase:
        """Where the mission stands."""
        return self._mission.state

    def of_agents(self) -> Rows:
        """(N,) `AgentPhase` of each agent."""
        return self._now

    def among(self, *phases: AgentPhase) -> Mask:
        """(N,) which agents are in one of some phases."""
        return among(self._now, *phases)

    def fire(self, trigger: str, rows: Iterable[int] | Rows) -> None:
        """Follow `trigger` for some agents; one for which it means nothing now stays as it is."""
        for row in rows:
            model = self._agents[row]
            model.trigger(trigger)  # type: ignore[attr-defined]  # made by the machine
            if model.state != self._now[row]:
                self._now = self._now.copy()  # earlier answers of `of_agents` stay as they were
                self._now[row] = model.state
                self._changes.append((self._names[row], model.state.name.lower()))

    def fire_mission(self, trigger: str) -> None:
        """Follow `trigger` for the mission."""
        before = self._mission.state
        self._mission.trigger(trigger)  # type: ignore[attr-defined]  # made by the machine
        if self._mission.state is not before:
            self._changes.append((None, str(self._mission.state)))

    def observe(self, state: Rows, heard: Mask, located: Mask) -> None:
        """Follow what the agents report.

        Args:
            state: (N,) bits of `Supervisor`; of use where `heard`.
            heard: (N,) whether the agent was heard lately.
            located: (N,) whether its estimate can be flown on.
        """
        seen = (state.tobytes(), heard.tobytes(), located.tobytes(), self._now.tobytes())
        if seen == self._seen:
            return  # nothing is new, so no trigger would mean anything
        self._seen = seen
        finished = heard & (state & int(Supervisor.COMMANDER_FINISHED) != 0)
        flying = state & int(Supervisor.FLYING) != 0
        fallen = heard & (state & FALLEN != 0) & ~self.among(_P.EMERGENCY)
        self.fire("fail", np.flatnonzero(fallen))
        self.fire("climbed", np.flatnonzero(finished & flying & self.among(_P.TAKING_OFF)))
        self.fire("down", np.flatnonzero(finished & ~flying & self.among(_P.LANDING)))
        fit = heard & located
        self.fire("lose", np.flatnonzero(~fit & self.among(_P.TAKING_OFF, _P.FLYING)))
        self.fire("find", np.flatnonzero(fit & flying & self.among(_P.LOST)))

    def changes(self) -> Iterator[tuple[str | None, str]]:
        """Every agent (None: the mission) and the phase it went into since the last call."""
        changes, self._changes = self._changes, []
        yield from changes
