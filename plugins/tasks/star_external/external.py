"""The task ``external``: agents fly to goals that another process sends.

The other process connects to the port by TCP and is sent JSON objects, one a line: a greeting
(`star_external.reports.greeting`), and then a state line a tick or at a rate
(`star_external.reports.state`). It sends goals, or that the step is over or failed
(`star_external.messages`). A line that is wrong is answered ``{"error": why, "line": number}`` and
changes nothing. Each of its lines, also ``{"goals": {}}``, is a sign of life. The connection is
closed when the step ends; the greeting is sent again when other agents are in the step.

In lock-step a simulation waits for exactly one line, right or wrong, in answer to each state line.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from star_core import Estimate, Goals, Health, InputError, Scene, Status, Step
from star_external.door import LONGEST, Door, Line
from star_external.messages import Done, Failed, Goal, Message, read
from star_external.offer import TIME_OUT
from star_external.rates import ticks_between
from star_external.reports import greeting, refusal, state

log = logging.getLogger(__name__)

LINES: Final = 50
"""Lines that are heard in a tick; what is more waits, and then the sender does."""

ROUNDING: Final = 1e-9
"""What mission time may lack of a whole number of ticks, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner:
    """How the other process is dealt with; as the options say.

    Attributes:
        rate: State lines a second, 1/s; None for one a tick.
        silence: For how long it may say nothing, s.
        then: What to do after that.
        patience: How long it is waited for, s.
        lockstep: Whether a simulation waits for its answers.
    """

    rate: float | None = None
    silence: float = 2.0
    then: Literal["hold", "fail"] = "hold"
    patience: float = 10.0
    lockstep: bool = True


class External:
    """Sends agents to the goals that another process gives.

    An agent keeps the goal it has until it is given one; the goal's velocity is fed forward and
    leads nowhere by itself.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        door: Where the other process connects.
        manner: How it is dealt with.
    """

    def __init__(self, scene: Scene, rows: tuple[int, ...], door: Door, manner: Manner) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._recruit(rows)
        self._door = door
        self._manner = manner
        self._waits = manner.lockstep and not scene.realtime
        self._every = ticks_between(manner.rate, scene.period)
        self._position, self._velocity = np.zeros((n, 3)), np.zeros((n, 3))
        self._yaw, self._speed = np.zeros(n), np.zeros(n)
        self._active = np.zeros(n, np.bool_)
        self._seen_turn: int | None = None  # of the door, when another step held it
        self._visitor: int | None = None  # of the door, the one that is there
        self._owed = False  # in lock-step: an answer
        self._patient = True  # in lock-step: answers are waited for
        self._ticks = 0
        self._begun = 0.0  # s
        self._heard: float | None = None  # s, when last; None before anybody came
        self._silent = False

    @property
    def address(self) -> tuple[str, int]:
        """Where it listens: address and port."""
        return self._door.address

    def begin(self, estimate: Estimate, health: Health) -> float:
        self._begun = estimate.time
        return TIME_OUT

    def step(self, estimate: Estimate, health: Health) -> Step:
        if not self._enter():
            return self._queue()
        self._door.turn += 1
        self._meet(estimate)
        if self._heard is None:
            return self._wait(estimate)
        due = self._ticks % self._every == 0
        self._ticks += 1
        if due and not self._owed:
            told = self._door.say(state(self._scene, self._rows, estimate, health), now=True)
            self._owed = self._waits and told
        for line in self._lines():
            match self._understood(line):
                case Done():
                    return self._end()
                case Failed(why):
                    return self._end(f"the other process gave up: {why}")
                case Mapping() as goals:
                    self._heard, self._silent = estimate.time, False
                    self._aim(goals, estimate)
        return self._fly(estimate, self._heard)

    def stay(self, rows: tuple[int, ...]) -> None:
        self._recruit(rows)
        self._active &= np.isin(np.arange(len(self._active)), rows)

    def join(self, rows: tuple[int, ...]) -> None:
        self._recruit(rows)

    def swap(self, old: int, new: int) -> None:
        self._recruit(tuple(new if row == old else row for row in self._rows))
        for table in (self._position, self._velocity, self._yaw, self._speed, self._active):
            table[new] = table[old]
        self._active[old] = False

    def close(self) -> None:
        self._door.close()

    def _recruit(self, rows: tuple[int, ...]) -> None:
        """Go on with these agents; whoever is connected is to be told of them."""
        self._rows = rows
        self._row_of = {self._scene.agents[row].name: row for row in rows}
        self._greeted: int | None = None  # which visitor knows who is in the step

    def _enter(self) -> bool:
        """Take the door, unless another step holds it that ran since this one looked last.

        A step that its condition or its time-out ended is not told, and still holds the door.
        """
        door = self._door
        if door.holder not in (None, self) and self._seen_turn != door.turn:
            return False
        if door.holder not in (None, self):
            door.hang_up()
        door.holder = self
        return True

    def _queue(self) -> Step:
        """Look for a tick whether the step that holds the door still runs."""
        if self._seen_turn is None:
            self._seen_turn = self._door.turn
            return Step()
        host, port = self._door.address
        why = f"another step that runs now listens on {host}:{port}; give each its own 'port'"
        return Step(status=Status.FAILURE, reason=why)

    def _meet(self, estimate: Estimate) -> None:
        """Let the other process in, and greet it."""
        new = self._waits and self._heard is None
        if not self._door.meet(self._manner.patience if new else 0.0):
            return
        if self._greeted == self._door.visitor:
            return
        rate = 1 / (self._every * self._scene.period)
        self._door.say(greeting(self._scene, self._rows, rate, lockstep=self._waits))
        if self._visitor != self._door.visitor:  # who has gone owes nothing any more
            self._visitor = self._door.visitor
            self._owed, self._patient = False, True
        self._greeted = self._door.visitor
        if self._heard is None:
            self._heard = estimate.time

    def _wait(self, estimate: Estimate) -> Step:
        """Wait for somebody to connect, for so long."""
        patience = self._manner.patience
        if not self._waits and estimate.time - self._begun < patience - ROUNDING:
            return Step()
        host, port = self._door.address
        return self._end(f"nobody connected to {host}:{port} within {patience:g} s")

    def _lines(self) -> list[Line]:
        """What was said since the last tick; in lock-step the answer that is owed."""
        if not self._waits:
            return self._door.hear(LINES, 0.0)
        if not self._owed:
            return []
        lines = self._door.hear(1, self._manner.patience if self._patient else 0.0)
        self._patient = bool(lines)
        self._owed = not lines and self._door.connected
        return lines

    def _understood(self, line: Line) -> Message | None:
        """What a line says; one that is wrong is answered, and says nothing."""
        why = f"the line is longer than {LONGEST} bytes"
        if line.text is not None:
            try:
                return read(line.text, self._scene, self._row_of)
            except InputError as error:
                why = str(error)
        self._door.say(refusal(why, line.number))
        return None

    def _aim(self, goals: Mapping[str, Goal], estimate: Estimate) -> None:
        for name, goal in goals.items():
            row = self._row_of[name]
            if goal.yaw is not None:
                self._yaw[row] = goal.yaw
            elif not self._active[row]:
                self._yaw[row] = estimate.yaw[row] if estimate.valid[row] else 0.0
            self._position[row], self._velocity[row] = goal.position, goal.velocity
            self._speed[row] = goal.speed or self._scene.limits.speed
            self._active[row] = True

    def _fly(self, estimate: Estimate, heard: float) -> Step:
        """Fly to the goals there are; without a sign of life for too long, hold or fail."""
        silence = self._manner.silence
        if estimate.time - heard >= silence - ROUNDING:
            if self._manner.then == "fail":
                return self._end(f"nothing was heard of the other process for {silence:g} s")
            if not self._silent:
                self._silent = True
                self._stop(estimate)
        if not self._active.any():
            return Step()
        return Step(
            Goals(
                position=self._position.copy(),
                velocity=self._velocity.copy(),
                yaw=self._yaw.copy(),
                speed=self._speed.copy(),
                active=self._active.copy(),
            )
        )

    def _stop(self, estimate: Estimate) -> None:
        """Make the place where each agent is its goal; one that is not located keeps its own."""
        self._velocity[:] = 0.0
        rows = [row for row in self._rows if estimate.valid[row]]
        self._position[rows], self._yaw[rows] = estimate.position[rows], estimate.yaw[rows]
        self._speed[rows] = self._scene.limits.speed
        self._active[rows] = True
        who = self._scene.named(self._rows)
        log.warning("external: the other process says nothing: %s hold their places", who)

    def _end(self, why: str = "") -> Step:
        """Leave the door, and end the step; a failure has a reason."""
        self._door.hang_up()
        self._door.holder = None
        return Step(status=Status.FAILURE if why else Status.SUCCESS, reason=why)
