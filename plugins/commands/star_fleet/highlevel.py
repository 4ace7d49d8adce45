"""The high-level commander: take-off, landing, go-to, spiral and uploaded trajectories, as a plan.

What it does and answers is the firmware's (``crtp_commander_high_level.c``, ``planner.c``): a plan
runs by the clock even while setpoints keep it from the motors; a take-off is refused while any plan
runs (1), a landing only while another landing does (1), everything that moves while the supervisor
forbids flight (EBUSY), and what it does not know or cannot do (ENOEXEC). An unknown trajectory is
accepted and nothing flies.
"""

from __future__ import annotations

import errno
import math
from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import Final

import numpy as np

from star_core import Array
from star_core.toolkit import transformed, wrap_angle
from star_fleet.craft import Craft
from star_fleet.packet import read, sound
from star_fleet.parameters import Parameters
from star_fleet.setpoints import Demand
from star_fleet.spiral import spiral
from star_fleet.trajectory import compressed, plain
from star_sim.commander import ending_at_rest
from star_sim.pieces import Piece

SET_GROUPS, STOP, DEFINE = 0, 3, 6  # commands; the others are for a group, and move
MAX_FIELD: Final = float(1 << 32)  # of a number in a command
DEFINITIONS: Final = 10  # trajectories that can be defined at once
IN_MEMORY: Final = 1  # the only location of trajectories
PLAIN, COMPRESSED = 0, 1  # their types
REFUSED: Final = 1  # a plan is in the way
LONGEST: Final = 3600.0  # s, of a plan


class Stage(Enum):
    """What a plan is doing."""

    IDLE = "idle"  # the motors are to be off
    FLYING = "flying"
    LANDING = "landing"


MEAN_SPEEDS: Final = {Stage.FLYING: "hlCommander.vtoff", Stage.LANDING: "hlCommander.vland"}
"""Parameters, m/s, of take-offs and landings whose commands have no speed."""


class HighLevel:
    """One vehicle's planner: plans start from the state of its craft."""

    def __init__(self, craft: Craft, memory: bytearray, parameters: Parameters) -> None:
        self._craft, self._memory, self._parameters = craft, memory, parameters
        self._stage = Stage.IDLE
        self._pieces: list[Piece] = []
        self._begins: list[float] = []  # s, of each piece
        self._defined: dict[int, tuple[int, int, int, int]] = {}  # location, type, offset, pieces
        self._commands: dict[int, tuple[str, Callable[..., int]]] = {
            SET_GROUPS: ("B", self._set_groups),
            1: ("Bff", partial(self._to_height, Stage.FLYING)),
            2: ("Bff", partial(self._to_height, Stage.LANDING)),
            STOP: ("B", self._stop),
            4: ("BB5f", self._go_to),
            5: ("BBBBf", self._start_old),
            DEFINE: ("BBBIB", self._define),
            7: ("Bff?f", partial(self._to_height, Stage.FLYING)),
            8: ("Bff?f", partial(self._to_height, Stage.LANDING)),
            9: ("Bf?f?f", partial(self._to_height_at_speed, Stage.FLYING)),
            10: ("Bf?f?f", partial(self._to_height_at_speed, Stage.LANDING)),
            11: ("BBB5f", self._spiral),
            12: ("BBB5f", self._go),
            13: ("BBBBBf", self._start),
        }

    def stage(self, now: float) -> Stage:
        """What the plan is doing at `now`, s. A landing that is over leaves it idle."""
        if self._stage is Stage.LANDING and now >= self._end:
            self._stage = Stage.IDLE
        return self._stage

    def finished(self, now: float) -> bool:
        """Whether the last plan's time is over; False if there has been none."""
        return bool(self._pieces) and now >= self._end

    def piece(self, now: float) -> tuple[Piece, float, bool, float] | None:
        """The piece to follow at `now`, s; None for motors off.

        Returns:
            The piece, when it began, s, whether the motors stop at its end, and until when it is
            the one to follow, s.
        """
        stage = self.stage(now)
        if stage is Stage.IDLE:
            return None
        i = max(0, int(np.searchsorted(self._begins, now, side="right")) - 1)
        last = i == len(self._pieces) - 1
        until = math.inf if last else self._begins[i + 1]
        return self._pieces[i], self._begins[i], last and stage is Stage.LANDING, until

    def plan(self, now: float) -> object:
        """Identity of the current plan; None if there is none at `now`, s."""
        return None if self.stage(now) is Stage.IDLE else self._pieces

    def stop(self) -> None:
        """Command the motors off."""
        self._stage = Stage.IDLE

    def obey(self, payload: bytes, now: float, *, blocked: bool) -> bytes:
        """Carry out a command at `now`, s, and return the answer: its first bytes and an errno."""
        return payload[:3].ljust(3, b"\0") + bytes([self._result(payload, now, blocked=blocked)])

    def _result(self, payload: bytes, now: float, *, blocked: bool) -> int:
        command = payload[0] if payload else -1
        if command not in self._commands:
            return errno.ENOEXEC
        form, act = self._commands[command]
        values = read(form, payload, 1)
        if values is None or not sound(values, MAX_FIELD):
            return errno.ENOEXEC
        if command in {SET_GROUPS, DEFINE}:
            return act(now, *values)
        if blocked and command != STOP:
            return errno.EBUSY
        group, *rest = values
        mine = int(self._parameters["hlCommander.groupmask"])
        return act(now, *rest) if group == 0 or group & mine else 0

    @property
    def _end(self) -> float:
        return self._begins[-1] + self._pieces[-1].duration

    def _reference(self, now: float) -> tuple[Array, Array, Array]:
        """Return pose, rate and acceleration, (4,) each, that a plan starts from."""
        if (current := self.piece(now)) is None:
            pose, rate = self._craft.state
            return pose, rate, np.zeros(4)
        piece, began, *_ = current
        pose, rate, acceleration = piece.at(now - began)
        over = self.finished(now)
        return (pose, np.zeros(4), np.zeros(4)) if over else (pose, rate, acceleration)

    def _plan(self, stage: Stage, pieces: list[Piece], now: float) -> int:
        self._stage, self._pieces = stage, pieces
        durations = [piece.duration for piece in pieces[:-1]]
        self._begins = (now + np.cumsum([0.0, *durations])).tolist()
        return 0

    def _vertical(
        self, stage: Stage, now: float, height: float, yaw: float | None, duration: float
    ) -> int:
        if not (_lasts(duration) and sound([height, yaw or 0.0])):
            return errno.ENOEXEC
        current = self.stage(now)
        if current is stage or (stage is Stage.FLYING and current is not Stage.IDLE):
            return REFUSED
        start, *_ = self._reference(now)
        turn = 0.0 if yaw is None else wrap_angle(yaw - start[3])
        end = np.array([start[0], start[1], height, start[3] + turn])
        return self._plan(stage, [_smooth(start, np.zeros(4), np.zeros(4), end, duration)], now)

    def _to_height(self, stage: Stage, now: float, height: float, *rest: float) -> int:
        return self._vertical(stage, now, height, *_yaw_and_last(rest))

    def _to_height_at_speed(
        self, stage: Stage, now: float, height: float, relative: int, *rest: float
    ) -> int:
        yaw, speed = _yaw_and_last(rest)
        z = float(self._reference(now)[0][2])
        if relative:
            height = z - height if stage is Stage.LANDING else z + height
        speed = speed if speed > 0 else self._parameters[MEAN_SPEEDS[stage]]
        duration = abs(height - z) / speed if speed > 0 else math.inf
        return self._vertical(stage, now, height, yaw, duration)

    def _stop(self, _now: float) -> int:
        self.stop()
        return 0

    def _go_to(self, now: float, relative: int, *rest: float) -> int:
        return self._go(now, relative, 0, *rest)

    def _go(self, now: float, relative: int, linear: int, *rest: float) -> int:
        *target, duration = rest
        if not (_lasts(duration) and sound(target)):
            return errno.ENOEXEC
        start, rate, acceleration = self._reference(now)
        end = np.array(target) + (start if relative else 0.0)
        end[3] = start[3] + wrap_angle(end[3] - start[3])
        if linear:
            coefficients = np.zeros((4, 8))
            coefficients[:, 0], coefficients[:, 1] = start, end - start
            return self._plan(Stage.FLYING, [Piece(coefficients, duration)], now)
        piece = _smooth(start, rate, acceleration, end, duration)
        return self._plan(Stage.FLYING, [piece], now)

    def _spiral(self, now: float, sideways: int, clockwise: int, *rest: float) -> int:
        if not (_lasts(rest[-1]) and sound(rest)):
            return errno.ENOEXEC
        start, *_ = self._reference(now)
        piece = spiral(start, bool(sideways), bool(clockwise), *rest)
        return self._plan(Stage.FLYING, [piece], now)

    def _define(
        self, _now: float, number: int, location: int, kind: int, offset: int, n: int
    ) -> int:
        if number >= DEFINITIONS:
            return errno.ENOEXEC
        self._defined[number] = location, kind, offset, n
        return 0

    def _start_old(self, now: float, relative: int, rest: int, number: int, scale: float) -> int:
        return self._start(now, relative, 0, rest, number, scale)

    def _start(
        self, now: float, relative: int, turned: int, backwards: int, number: int, scale: float
    ) -> int:
        location, kind, offset, count = self._defined.get(number, (0, 0, 0, 0))
        if location != IN_MEMORY or kind not in {PLAIN, COMPRESSED}:
            return 0
        memory = bytes(self._memory)
        if kind == PLAIN:
            pieces = plain(memory, offset, count)
        else:
            pieces = compressed(memory, offset) if scale == 1 and not backwards else None
        if pieces is None or not 0 < scale <= LONGEST:
            return errno.ENOEXEC
        if backwards:
            pieces = [piece.backwards() for piece in reversed(pieces)]
        pieces = [piece.slower(scale) for piece in pieces]
        if not _lasts(sum(piece.duration for piece in pieces)):
            return errno.ENOEXEC
        if relative:
            pieces = self._from_reference(pieces, now, turned=bool(turned))
        return self._plan(Stage.FLYING, pieces, now)

    def _from_reference(self, pieces: list[Piece], now: float, *, turned: bool) -> list[Piece]:
        """Return pieces that start at the reference, turned about their start to its heading."""
        reference, first = self._reference(now)[0], pieces[0].coefficients[:, 0]
        turn = wrap_angle(reference[3] - first[3]) if turned else 0.0
        start = transformed(first[:, None], turn)[:3, 0]
        return [piece.moved(reference[:3] - start, turn) for piece in pieces]

    def _set_groups(self, _now: float, groups: int) -> int:
        self._parameters.put("hlCommander.groupmask", groups)
        return 0


def _smooth(start: Array, rate: Array, acceleration: Array, end: Array, duration: float) -> Piece:
    """Return the piece that comes to rest at `end`, as the firmware's planner makes it."""
    return Piece(ending_at_rest(start, rate, acceleration, end, np.full(4, duration)), duration)


def _yaw_and_last(rest: tuple[float, ...]) -> tuple[float | None, float]:
    """Return the heading at the end, rad, None for the present one, and the last number."""
    if len(rest) == 1:
        return 0.0, rest[0]
    yaw, present, last = rest
    return (None if present else yaw), last


def _lasts(duration: float) -> bool:
    return 0 < duration <= LONGEST


class Guidance:
    """Passes the active reference to the position loop."""

    def __init__(self, craft: Craft, high_level: HighLevel) -> None:
        self._craft, self._high_level = craft, high_level
        self._demand: Demand | None = None  # None: the high-level commander has the priority
        self._stamp = 0.0  # s, when the demand came
        self._levels = False
        self._allowed = False
        self._until = math.inf  # s, when the plan's next piece begins

    @property
    def allowed(self) -> bool:
        """Whether the supervisor lets the motors run."""
        return self._allowed

    def silence(self, now: float) -> float:
        """Time without a setpoint, s; 0 while the high-level commander has the priority."""
        return 0.0 if self._demand is None else now - self._stamp

    def stream(self, demand: Demand, now: float) -> None:
        """Fly an external setpoint at `now`, s."""
        self._demand, self._stamp = demand, now
        self._high_level.stop()
        self._steer(now)

    def let_go(self, now: float) -> None:
        """Return the priority to the high-level commander at `now`, s."""
        self._demand = None
        self._steer(now)

    def obey(self, payload: bytes, now: float) -> bytes:
        """Carry out a command to the high-level commander, and return the answer."""
        before = self._high_level.plan(now)
        answer = self._high_level.obey(payload, now, blocked=not self._allowed)
        if self._demand is None and self._high_level.plan(now) is not before:
            self._steer(now)
        return answer

    def permit(self, now: float, *, allowed: bool, levels: bool) -> None:
        """Apply the supervisor's decisions at `now`, s: motors allowed, level out."""
        if (allowed, levels) == (self._allowed, self._levels):
            return
        if not allowed:
            self._high_level.stop()
        self._allowed, self._levels = allowed, levels
        self._steer(now)

    def advance(self, now: float) -> None:
        """Start the plan's next piece if it is due at `now`, s."""
        if now >= self._until:
            self._steer(now)

    def _steer(self, now: float) -> None:
        self._until = math.inf
        if not self._allowed:
            self._craft.stop()
        elif self._demand is not None:
            self._craft.demand(self._demand.levelled() if self._levels else self._demand)
        elif (current := self._high_level.piece(now)) is None:
            self._craft.stop()
        else:
            piece, began, lands, self._until = current
            self._craft.follow(piece, began, lands=lands)
