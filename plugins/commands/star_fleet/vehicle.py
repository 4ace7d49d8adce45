"""Firmware of one simulated vehicle, as seen by its link: packets in, packets out, no sockets.

This module and those it calls process packets like the firmware, except that malformed packets and
values that cannot be flown (not finite, or beyond 10 000), which the firmware would accept, are
dropped. After 1 s without any packet, null packets included, the firmware deletes all log blocks
and the packets that wait to be sent (``log.c``, ``radiolink.c``); it flies on.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from star_core import Supervisor as Bits
from star_fleet import log, parameters
from star_fleet.conditions import SWITCHES, Condition
from star_fleet.craft import Craft
from star_fleet.decks import DECKS, MULTIRANGER, Equipment
from star_fleet.highlevel import Guidance, HighLevel, Stage
from star_fleet.memory import Memories
from star_fleet.packet import MAX_PAYLOAD, NULL, Port, is_null, join, sound, split
from star_fleet.setpoints import Fix, Sticks, decode, fixes
from star_fleet.supervisor import Conditions, State, Supervisor
from star_fleet.variables import Readings

PROTOCOL: Final = 12
FIRMWARE: Final = b"STAR simulation"
DEVICE: Final = b"Crazyflie 2.1"
MAGIC: Final = b"Bitcraze Crazyflie"  # by which clients detect that a version can be requested

ECHO, SOURCE = 0, 1  # channels of the link
SET, META = 0, 1  # channels of the setpoints
TABLE = 0  # channel of tables of contents
INFO, COMMAND = 0, 1  # channels of the supervisor and of the platform
ANSWER: Final = 0x80
ARM, RECOVER, EMERGENCY_STOP, KEEP_ALIVE = 1, 2, 3, 4  # commands to the supervisor
BITS: Final = 0x0C
LINK_TIMEOUT: Final = 1.0  # s, the firmware's default of RADIO_ACTIVITY_TIMEOUT_MS
VERSION, FIRMWARE_NAME, DEVICE_NAME = 0, 1, 2
LOC_EMERGENCY_STOP, LOC_KEEP_ALIVE, LOC_PERSIST_STATIONS = 3, 4, 11

MIN_DEVIATION: Final = 1e-4  # m and rad: a fix is never without error

CONSOLE_MESSAGES: Final = {
    State.LOCKED: b"SUP: Locked, reboot required\n",
    State.CRASHED: b"SUP: Crashed, recovery required\n",
}


class Vehicle:
    """A vehicle's firmware.

    Args:
        craft: The vehicle's craft.
        row: Its row in the readings.
        address: Radio address, five bytes; the last one identifies it in packed positions.
        arms_itself: Whether its motors are brushed.
        booted: Time of its start, s since the start of the fleet.
        link_timeout: Time without a packet after which its log blocks are deleted, s.
        conditions: Its conditions before the flight.
        equipment: What it has beside the decks of mission and conditions.
    """

    def __init__(
        self,
        craft: Craft,
        row: int,
        address: int,
        *,
        arms_itself: bool,
        booted: float,
        link_timeout: float,
        conditions: frozenset[Condition],
        equipment: Equipment,
    ) -> None:
        self.supervisor = Supervisor(arms_itself=arms_itself)
        self.info = 0
        self._craft = craft
        self._booted = booted
        self._name = address & 0xFF
        self._parameters = parameters.Parameters(self._written)
        self._conditions = conditions
        self._begin_in_condition(craft)
        self._parameters.put("stabilizer.controller", craft.controller)
        for deck in equipment.decks:
            self._parameters.put(deck.parameter, 1)
        carried = [deck for deck in DECKS if self._parameters[deck.parameter]]
        self.ranges = MULTIRANGER in carried
        """Whether it measures distances to obstacles."""
        self._memories = Memories(address, carried, equipment)
        self._high_level = HighLevel(craft, self._memories.trajectory, self._parameters)
        self._guidance = Guidance(craft, self._high_level)
        self._log = log.Log(row)
        self._sticks = Sticks()
        self._console = [b"SYS: Crazyflie 2.1 is up and running!\n"]
        self._link_timeout = link_timeout
        self._heard = False  # console output waits for the first packet of a client
        self._connected_until = -math.inf  # s
        self._ports: Final[dict[int, Callable[[int, bytes, float], bytes | None]]] = {
            Port.PARAMETERS: self._on_parameters,
            Port.ATTITUDE: self._on_attitude,
            Port.MEMORY: lambda channel, payload, _now: self._memories.answer(channel, payload),
            Port.LOG: self._on_log,
            Port.LOCALISATION: self._on_localisation,
            Port.SETPOINT: self._on_setpoint,
            Port.HIGH_LEVEL: lambda _channel, payload, now: self._guidance.obey(payload, now),
            Port.SUPERVISOR: self._on_supervisor,
            Port.PLATFORM: self._on_platform,
            Port.LINK: self._on_link,
        }

    def _begin_in_condition(self, craft: Craft) -> None:
        """Set decks, self-test, supervisor and estimator as they are after a boot."""
        if Condition.NO_FLOW_DECK in self._conditions:
            for deck in ("Flow2", "ZRanger2"):
                self._parameters.put(f"deck.bc{deck}", 0)
        if self._conditions & {Condition.LIGHTHOUSE, Condition.NO_STATIONS}:
            self._parameters.put("deck.bcLighthouse4", 1)
        if Condition.LOCO in self._conditions:
            self._parameters.put("deck.bcLoco", 1)
        craft.receive_positions(on=self._knows_map())
        if self._knows_map():
            craft.begin_estimate_in_map()
        if Condition.FAILED_SELF_TEST in self._conditions:
            self._parameters.put("system.selftestPassed", 0)
        if Condition.LOCKED in self._conditions:
            self.supervisor.state = State.LOCKED
        if Condition.CRASHED in self._conditions:
            self.supervisor.state = State.CRASHED

    @property
    def write_errors(self) -> int:
        """Bytes that the memory tester was given that were not their own addresses."""
        return self._memories.tester.errors

    def handle(self, packet: bytes, now: float, *, tcp: bool = False) -> list[bytes]:
        """Process a packet at `now`, s since the start, and return the answers.

        Only the firmware's radio link has a timeout, its link over TCP (`tcp`) has none.
        """
        self._connected_until = math.inf if tcp else now + self._link_timeout
        if is_null(packet):
            return [NULL]
        parts = split(packet)
        if parts is None:
            return []
        self._heard = True
        port, channel, payload = parts
        act = self._ports.get(port)
        answer = None if act is None else act(channel, payload, now)
        return [] if answer is None else [join(port, channel, answer)]

    def advance(self, readings: Readings, now: float) -> list[bytes]:
        """Advance to `now`, s, and return the unsolicited packets."""
        self._guidance.advance(now)
        packets = list(self._log.due(readings, now - self._booted))
        if packets and now >= self._connected_until:  # the firmware checks it when a block is due
            self._log.reset()
            self._console.clear()
            return []
        if self._console and self._heard:
            text = b"".join(self._console)
            self._console.clear()
            packets += [
                join(Port.CONSOLE, 0, text[at : at + MAX_PAYLOAD])
                for at in range(0, len(text), MAX_PAYLOAD)
            ]
        return packets

    def supervise(self, now: float, *, tumbled: bool, crashed: bool, resting: float) -> None:
        """Update the supervisor and its console output, 25 times a second.

        Args:
            now: s.
            tumbled: Whether the vehicle lies on its back or side.
            crashed: Whether it has tumbled in flight.
            resting: For how long its motors have been off, s.
        """
        conditions = Conditions(
            tumbled=tumbled or Condition.TUMBLED in self._conditions,
            crashed=crashed or Condition.CRASHED in self._conditions,
            resting=resting,
            silence=self._guidance.silence(now),
            emergency=self._parameters["stabilizer.stop"] != 0,
        )
        entered = self.supervisor.update(conditions, now)
        if entered is State.LOCKED:
            self._craft.lock()
        if entered in CONSOLE_MESSAGES:
            self._console.append(CONSOLE_MESSAGES[entered])
        state = self.supervisor.state
        self._guidance.permit(
            now, allowed=self.supervisor.motors_may_run, levels=state is State.LEVELLING
        )
        self.info = self.supervisor.bits(
            plans=self._high_level.stage(now) is not Stage.IDLE,
            finished=self._high_level.finished(now),
        )
        if Condition.DECK_FAULT in self._conditions:
            self.info |= int(Bits.DECK_FAULT)

    def _on_parameters(self, channel: int, payload: bytes, _now: float) -> bytes | None:
        if channel == TABLE:
            return parameters.CONTENTS.answer(payload)
        return self._parameters.answer(channel, payload)

    def _on_attitude(self, channel: int, payload: bytes, now: float) -> None:
        mode = {
            name: self._parameters[f"flightmode.{name}"]
            for name in ("althold", "poshold", "posSet", "stabModeRoll", "stabModePitch")
        }
        if channel == 0 and (demand := self._sticks.decode(payload, mode)) is not None:
            self._guidance.stream(demand, now)

    def _on_setpoint(self, channel: int, payload: bytes, now: float) -> None:
        if channel == SET and (demand := decode(payload)) is not None:
            self._guidance.stream(demand, now)
        elif channel == META and payload[:1] == b"\0":
            self._guidance.let_go(now)

    def _on_log(self, channel: int, payload: bytes, now: float) -> bytes | None:
        if channel == TABLE:
            return log.CONTENTS.answer(payload)
        return self._log.answer(payload, now - self._booted) if channel == log.CONTROL else None

    def _on_localisation(self, channel: int, payload: bytes, now: float) -> bytes | None:
        if channel == COMMAND and payload[:1] == bytes([LOC_EMERGENCY_STOP]):
            self.supervisor.stop()
        elif channel == COMMAND and payload[:1] == bytes([LOC_KEEP_ALIVE]):
            self.supervisor.keep_alive(now)
        for fix in fixes(channel, payload):
            if fix.name is None or fix.name == self._name:
                self._correct(fix)
        stores = channel == COMMAND and payload[:1] == bytes([LOC_PERSIST_STATIONS])
        return bytes([LOC_PERSIST_STATIONS, 1]) if stores else None

    def _correct(self, fix: Fix) -> None:
        position_std = self._deviation("locSrv.extPosStdDev")
        if fix.attitude is None:
            self._craft.correct(fix.position, position_std)
        else:
            attitude_std = self._deviation("locSrv.extQuatStdDev")
            self._craft.correct(fix.position, position_std, fix.attitude, attitude_std)

    def _deviation(self, name: str) -> float:
        return max(abs(self._parameters[name]), MIN_DEVIATION)

    def _on_supervisor(self, channel: int, payload: bytes, now: float) -> bytes | None:
        if not payload:
            return None
        command = payload[0]
        if channel == INFO:
            if command == BITS:
                return bytes([ANSWER | command]) + self.info.to_bytes(2, "little")
            if 1 <= command < BITS:
                return bytes([ANSWER | command, self.info >> command - 1 & 1])
        elif channel == COMMAND:
            if command == EMERGENCY_STOP:
                self.supervisor.stop()
            elif command == KEEP_ALIVE:
                self.supervisor.keep_alive(now)
            elif (result := self._arm_or_recover(command, payload)) is not None:
                return bytes([ANSWER | command, *result])
        return None

    def _arm_or_recover(self, command: int, payload: bytes) -> tuple[bool, bool] | None:
        """Execute it; return whether that succeeded, and whether the vehicle is armed or sound."""
        if command == ARM and len(payload) > 1:
            return self.supervisor.arm(armed=payload[1] != 0), self.supervisor.armed
        if command == RECOVER:
            if not self._craft.tumbled:
                self._craft.recover()
            return (not self._craft.crashed,) * 2
        return None

    def _on_platform(self, channel: int, payload: bytes, _now: float) -> bytes | None:
        if not payload:
            return None
        command = payload[0]
        if channel == INFO:
            result = self._arm_or_recover(command, payload)
            return payload if result is None else bytes([command, *result])
        if channel == COMMAND:
            if command == VERSION:
                return bytes([VERSION]) + PROTOCOL.to_bytes(4, "little")
            if command in {FIRMWARE_NAME, DEVICE_NAME}:
                return bytes([command]) + (FIRMWARE if command == FIRMWARE_NAME else DEVICE)
        return None

    def _on_link(self, channel: int, payload: bytes, _now: float) -> bytes | None:
        if channel == ECHO:
            return payload
        return MAGIC.ljust(MAX_PAYLOAD, b"\0") if channel == SOURCE else None

    def _knows_map(self) -> bool:
        """Return whether a positioning system corrects its estimator."""
        systems = [name for system, name in SWITCHES.items() if system in self._conditions]
        return any(not name or self._parameters[name] for name in systems)

    def _written(self, name: str) -> None:
        """Apply the immediate effect of a written parameter."""
        if name == "stabilizer.controller":
            self._craft.controller = int(self._parameters[name])
        if name == "memTst.resetW" and self._parameters[name]:
            self._memories.tester.errors = 0
            self._parameters.put(name, 0)
        if name in SWITCHES.values():
            self._craft.receive_positions(on=self._knows_map())
        if name != "kalman.resetEstimation" or not self._parameters[name]:
            return
        x, y, yaw = (self._parameters[f"kalman.initial{axis}"] for axis in ("X", "Y", "Yaw"))
        if self._knows_map():
            self._craft.begin_estimate_in_map()
        elif sound([x, y, yaw]):
            self._craft.begin_estimate(x, y, math.remainder(yaw, math.tau))
        self._parameters.put(name, 0)
