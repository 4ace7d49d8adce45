"""The supervisor of one vehicle: whether its motors may run, by the firmware's states.

The states of ``supervisor_state_machine.c``: a vehicle that flies levels out when no setpoint came
for 0.5 s, and is locked after 2 s, as on an emergency stop; a tumble in flight is a crash, from
which it can recover. A vehicle that levels out does not count as landed: closing the link within
1.5 s of landing locks it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from star_core import Supervisor as Bits

PERIOD: Final = 0.04  # s, from one update to the next: 25 Hz
LEVEL_AFTER: Final = 0.5  # s without a setpoint
LOCK_AFTER: Final = 2.0  # s without a setpoint
STILL_FLYING: Final = 2.0  # s after the motors were last on
PREFLIGHT: Final = 30.0  # s that a vehicle stays armed without flying
LANDED: Final = 3.0  # s that it stays armed after landing
KEEP_ALIVE: Final = 1.0  # s, within which the emergency-stop watchdog must be reset


class State(Enum):
    """Where a vehicle stands."""

    UNFIT = "pre-flight checks not passed"
    FIT = "pre-flight checks passed"
    READY = "ready to fly"
    FLYING = "flying"
    LANDED = "landed"
    LEVELLING = "warning, level out"
    LOCKED = "locked"
    CRASHED = "crashed"


MOTORS_RUN: Final = frozenset({State.READY, State.FLYING, State.LANDED, State.LEVELLING})


# Numbers, as sums of flags are made 25 times a second for each vehicle.
_ARMED, _AUTO_ARM, _TUMBLED = int(Bits.ARMED), int(Bits.AUTO_ARM), int(Bits.TUMBLED)
_ACTIVE, _FINISHED = int(Bits.COMMANDER_ACTIVE), int(Bits.COMMANDER_FINISHED)
_STATE_BITS: Final = {
    State.UNFIT: 0,
    State.FIT: int(Bits.CAN_ARM),
    State.READY: int(Bits.CAN_FLY),
    State.FLYING: int(Bits.CAN_FLY | Bits.FLYING),
    State.LANDED: int(Bits.CAN_FLY),
    State.LEVELLING: int(Bits.CAN_FLY | Bits.FLYING),
    State.LOCKED: int(Bits.LOCKED),
    State.CRASHED: int(Bits.CRASHED),
}


@dataclass(frozen=True, slots=True)
class Conditions:
    """What is found at an update.

    Attributes:
        tumbled: It lies on its back or side.
        crashed: It has tumbled with its motors on, without a recovery since.
        resting: Time since the motors were on, s.
        silence: Time since the last setpoint, s.
        emergency: A stop was requested by a parameter.
    """

    tumbled: bool
    crashed: bool
    resting: float
    silence: float
    emergency: bool = False


class Supervisor:
    """States, and what leads from one to the next."""

    def __init__(self, *, arms_itself: bool = True) -> None:
        self.state = State.UNFIT
        self.armed = False
        self._arms_itself = arms_itself
        self._since = 0.0  # s, when the state was entered
        self._stopped = False
        self._watchdog_reset: float | None = None  # s, last reset of the watchdog
        self._tumbled = False

    @property
    def motors_may_run(self) -> bool:
        """Whether setpoints reach the motors."""
        return self.state in MOTORS_RUN

    def stop(self) -> None:
        """Stop for good, at the next update."""
        self._stopped = True

    def keep_alive(self, now: float) -> None:
        """Start the watchdog at `now`, s, or put it off: 1 s without another is a stop."""
        self._watchdog_reset = now

    def arm(self, *, armed: bool) -> bool:
        """Arm or disarm; return False if it cannot be armed."""
        if armed and not self.armed and self.state is not State.FIT:
            return False
        self.armed = armed
        return True

    def bits(self, *, plans: bool, finished: bool) -> int:
        """Return ``supervisor.info`` of a vehicle that has a plan, or one whose time is over."""
        bits = _STATE_BITS[self.state] | _ARMED * self.armed | _AUTO_ARM * self._arms_itself
        return bits | _TUMBLED * self._tumbled | _ACTIVE * plans | _FINISHED * finished

    def update(self, conditions: Conditions, now: float) -> State | None:
        """Go where the conditions lead at `now`, s; return the state if it is another one."""
        self._tumbled = conditions.tumbled
        after = self._next(conditions, now)
        if after is self.state:
            return None
        self.state, self._since = after, now
        if after not in MOTORS_RUN:
            self.armed = after is State.FIT and self._arms_itself
        return after

    def _next(self, conditions: Conditions, now: float) -> State:  # noqa: C901, PLR0911, PLR0912 -- a table
        state, flies = self.state, conditions.resting < STILL_FLYING
        if state is State.LOCKED:
            return state
        late = self._watchdog_reset is not None and now - self._watchdog_reset > KEEP_ALIVE
        if self._stopped or late or conditions.emergency:
            return State.LOCKED
        match state:
            case State.FLYING | State.LEVELLING:
                if conditions.tumbled or conditions.crashed:
                    return State.CRASHED
                if conditions.silence > LOCK_AFTER:
                    return State.LOCKED
                if not self.armed:
                    return State.UNFIT
                if state is State.LEVELLING:
                    return state if conditions.silence > LEVEL_AFTER else State.FLYING
                if conditions.silence > LEVEL_AFTER:
                    return State.LEVELLING
                return state if flies else State.LANDED
            case State.CRASHED:
                return state if conditions.crashed or conditions.tumbled else State.UNFIT
            case State.UNFIT:
                return state if conditions.tumbled or conditions.crashed else State.FIT
            case State.FIT:
                if conditions.tumbled:
                    return State.UNFIT
                return State.READY if self.armed else state
            case State.READY if conditions.tumbled or not self.armed:
                return State.UNFIT
            case State.LANDED if not self.armed:
                return State.UNFIT
        if flies:
            return State.FLYING
        patience = PREFLIGHT if state is State.READY else LANDED
        idle = now - self._since > patience and not self._arms_itself  # else it is rearmed at once
        return State.UNFIT if idle else state
