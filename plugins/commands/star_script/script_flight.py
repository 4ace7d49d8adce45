"""Flies what a script commands: in lock-step with it, or in real time beside it."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from time import monotonic as clock
from typing import Any, Final

import numpy as np

from star_core import AgentPhase, Array, Command, Goals, Mission, Order, Setpoint, StarError, Tick
from star_core.toolkit import shortlist
from star_script.motions import Flown, GoTo, Hold, Motion, State, Steered, Streamed

MAX_HORIZON: Final = 60.0  # s, for which motions are compared with each other
SETPOINT_HORIZON: Final = 0.5  # s, the same of setpoints
SAMPLE: Final = 0.1  # s
HEIGHT_GAIN: Final = 1.5  # 1/s, of hover setpoints
PATIENCE: Final = 1.0  # s of real time, for threads of the script that do not sleep
POLL: Final = 0.001  # s of real time
MOST_POLLS: Final = 1000  # within a tick
RETREAT: Final = 0.01  # m by which agents that are too near may approach each other further
GROUND: Final = frozenset({AgentPhase.GROUNDED, AgentPhase.LANDED})
OWN: Final = str(Path(__file__).parent)


class ScriptError(StarError):
    """A command of a script that would lead to a collision or out of the world."""

    code = "script-refused"


class ScriptFlight:
    """An open flight whose agents move as a script commands.

    The script calls everything but `serve`. In simulation mission time advances while it sleeps,
    or while all its threads do, if it has several. Where mission time advances by itself, another
    thread calls `serve`, and a sleep waits for it.

    Args:
        flight: Of `star_core.open_flight`.
        mission: What it flies.
        report: Records an event: kind, text, agent and details.

    Attributes:
        scene: The agents.
        realtime: Whether mission time advances by itself.
        masks: Group mask of each agent.
        ended: Why the flight ended; None while it goes on.
    """

    def __init__(self, flight: Any, mission: Mission, report: Callable[..., None]) -> None:
        n = len(mission.scene.agents)
        self._flight, self._report = flight, report
        self.scene = mission.scene
        self.realtime = mission.scene.realtime
        self.masks = [0] * n
        self.ended: StarError | None = None
        self._motions: list[Motion | None] = [None] * n
        self._climbs: dict[int, tuple[float, float, str]] = {}  # height, duration and line
        self._commands: list[Command] = []
        self._parameters: list[tuple[list[str], dict[str, float]]] = []  # agents and values
        self._changed = self._moved = False
        self._ticked = threading.Condition(threading.RLock())
        self._polls = 0  # since the last tick
        self._ticking = False
        self._threads: set[threading.Thread] = set()  # that have slept in lock-step
        self._sleepers: dict[threading.Thread, float] = {}  # until when, s
        self._others = {*threading.enumerate()} - {threading.current_thread()}  # not the script's
        self._step()

    @property
    def time(self) -> float:
        """Mission time, s."""
        return float(self._flight.time)

    @property
    def tick(self) -> Tick:
        """The last tick."""
        tick: Tick = self._flight.tick
        return tick

    def sleep(self, until: float) -> None:
        """Return at a mission time, s.

        Raises:
            StarError: The flight ended.
        """
        until -= self.scene.period / 100  # mission time is a sum of ticks
        if self.realtime:
            with self._ticked:
                self._ticked.wait_for(lambda: self.ended is not None or self.time >= until)
        else:
            self._sleep_in_lock_step(until)
        if self.ended is not None:
            raise self.ended

    def _sleep_in_lock_step(self, until: float) -> None:
        """Fly until a mission time, s: one of the threads that sleep flies the ticks for all."""
        thread = threading.current_thread()
        with self._ticked:
            self._others.discard(thread)
            self._threads.add(thread)
            self._sleepers[thread] = until
            while self.ended is None and self.time < until:
                if self._ticking:
                    self._ticked.wait()
                    continue
                self._ticking = True
                try:
                    self._await_threads()
                    if self.ended is None:
                        self.advance()
                finally:
                    self._ticking = False
                    self._ticked.notify_all()
                for sleeper, end in [*self._sleepers.items()]:
                    if self.time >= end:
                        del self._sleepers[sleeper]
            self._sleepers.pop(thread, None)

    def _await_threads(self) -> None:
        """Wait until all threads of the script sleep, except those that do not for too long.

        These wait for another thread, or are none of the script's.
        """
        end = clock() + PATIENCE
        while awake := {*threading.enumerate()} - self._others - {*self._sleepers}:
            if self.ended is not None:
                return
            if clock() > end:
                self._others |= awake
                return
            self._ticked.wait(POLL)

    def poll(self) -> None:
        """Fly a tick if a script asks for times or positions again and again, without sleeping."""
        self._polls += 1
        if self._polls > MOST_POLLS and not self.realtime:
            self.sleep(self.time + self.scene.period)

    def serve(self, script: threading.Thread) -> None:
        """Fly in real time until a thread that runs the script ends, or the flight does."""
        while script.is_alive() and self.ended is None:
            self.advance()

    def advance(self) -> None:
        """Fly a tick."""
        self._polls = 0
        try:
            with self._ticked:
                self._prepare()
            self._step()
        except StarError as error:
            self.ended = error
        with self._ticked:
            self._ticked.notify_all()

    def end(self) -> None:
        """End the script's flight, also for threads that it has left behind."""
        with self._ticked:
            self.ended = self.ended or StarError("the script has ended", "flight-ended")
            self._ticked.notify_all()
        for thread in self._threads - {threading.current_thread()}:
            thread.join(PATIENCE)

    def rows(self, mask: int) -> list[int]:
        """Return the agents that heed a broadcast with a group mask."""
        return [row for row, own in enumerate(self.masks) if not mask or mask & own]

    def take_off(self, rows: Iterable[int], height: float, duration: float) -> None:
        """Climb to a height, m, in some time, s.

        Raises:
            ScriptError: It is outside of those to fly at.
        """
        line = script_line()
        if fault := self.scene.height_fault(height):
            raise ScriptError(f"{line}: takeoff: {fault}")
        with self._ticked:
            for row in self._logged("takeoff", rows, line):
                if self._phase(row) in GROUND | {AgentPhase.LANDING}:
                    self._climbs[row] = height, max(duration, 0.1), line
                else:
                    state = self._state(row)
                    target = np.array([*state.position[:2], height])
                    self._move(row, GoTo(state, target, state.yaw, self.time, duration, line))

    def land(self, rows: Iterable[int], duration: float) -> None:
        """Descend to the floor in some time, s."""
        line = script_line()
        with self._ticked:
            up = []
            for row in self._logged("land", rows, line):
                self._climbs.pop(row, None)
                if self._phase(row) not in GROUND:
                    up.append(row)
                self._motions[row] = None
            if up:
                agents, k = np.array(up, np.int64), len(up)
                floor = self.tick.estimate.position[agents].copy()
                floor[:, 2] = 0.0
                yaw, seconds = self.tick.estimate.yaw[agents], np.full(k, max(duration, 0.1))
                self._commands.append(Command(Order.LAND, agents, floor, yaw, seconds))

    def go_to(
        self, rows: Iterable[int], goal: Sequence[float], yaw: float, duration: float, *,
        relative: bool,
    ) -> None:  # fmt: skip
        """Fly to a position, m, with a heading, rad, in some time, s; or by an offset and a turn.

        Raises:
            ScriptError: No agent can be there.
        """
        line, offset = script_line(), np.array(goal, np.float64).reshape(3)
        with self._ticked:
            for row in self._logged("goTo", rows, line):
                start = self._state(row)
                position = start.position + offset if relative else offset
                heading = start.yaw + yaw if relative else yaw
                self._require_free(row, position, "goTo", line)
                motion = GoTo(start, position, heading, self.time, max(duration, 0.1), line)
                self._move(row, motion)

    def start_trajectory(
        self, row: int, pieces: Sequence[tuple[float, Array]], *, timescale: float, reverse: bool,
        relative: bool,
    ) -> None:  # fmt: skip
        """Fly polynomial pieces.

        Raises:
            ScriptError: They lead where no agent can be.
        """
        line = script_line()
        with self._ticked:
            self._logged("startTrajectory", [row], line)
            motion = Flown(
                pieces,
                self._state(row),
                self.time,
                timescale=timescale,
                reverse=reverse,
                relative=relative,
                line=line,
            )
            for time in np.arange(self.time, motion.end + SAMPLE, SAMPLE).tolist():
                self._require_free(row, motion.at(time).position, "startTrajectory", line)
            self._move(row, motion)

    def stream(self, row: int, state: State, name: str) -> None:
        """Fly a setpoint of a state.

        Raises:
            ScriptError: No agent can be at its position.
        """
        line = script_line()
        with self._ticked:
            self._require_free(row, state.position, name, line)
            self._move(row, Streamed(state, self.time, line), setpoint=True)

    def steer(
        self, row: int, velocity: Sequence[float], yaw_rate: float, *, height: float | None = None
    ) -> None:
        """Fly a setpoint of a velocity, m/s, in the map, or of the body at a height, m."""
        with self._ticked:
            state = self._state(row)
            position = self.tick.estimate.position[row]
            motion = Steered(
                position,
                np.array(velocity, np.float64).reshape(3),
                state.yaw,
                yaw_rate,
                self.time,
                script_line(),
                height=height,
                in_body=height is not None,
            )
            self._move(row, motion, setpoint=True)

    def stop_setpoints(self, rows: Iterable[int]) -> None:
        """Hover where setpoints have led to."""
        with self._ticked:
            for row in rows:
                if isinstance(self._motions[row], Streamed | Steered):
                    state = self._state(row)
                    self._motions[row] = Hold(state.position, state.yaw, script_line())

    def stop_motors(self, rows: Sequence[int]) -> None:
        """Stop the motors at once."""
        line = script_line()
        with self._ticked:
            self._logged("emergency", rows, line)
            for row in rows:
                self._motions[row] = None
                self._climbs.pop(row, None)
            self._commands.append(_still(Order.STOP, rows))

    def arm(self, row: int, *, arm: bool) -> None:
        """Arm an agent on the ground; before a take-off the transport does that anyway."""
        with self._ticked:
            self._logged("arm", [row], script_line(), f" {arm}")
            if arm and self._phase(row) in GROUND:
                self._commands.append(_still(Order.ARM, [row]))

    def set_parameters(
        self, rows: Sequence[int], values: Mapping[str, Any], name: str, text: str
    ) -> None:
        """Set parameters of agents' firmware, for a call of a name with the arguments in a text.

        Raises:
            ValueError: A value is no number.
        """
        with self._ticked:
            numbers = {key: float(value) for key, value in values.items()}
            self._logged(name, rows, script_line(), f" {text}")
            self._parameters.append(([self.scene.names[row] for row in rows], numbers))

    def _logged(
        self, name: str, rows: Iterable[int], line: str, more: str = ""
    ) -> list[int]:  # fmt: skip
        """Record a command; return its agents."""
        if self.ended is not None:
            raise self.ended
        agents = list(rows)
        if agents:
            names = [self.scene.names[row] for row in agents]
            text = f"{line} {name} {shortlist(names)}{more}"
            details = {"location": f"{line}:1", "verb": name, "agents": names}
            self._report("script", text, names[0] if len(names) == 1 else None, details)
        return agents

    def _move(self, row: int, motion: Motion, *, setpoint: bool = False) -> None:
        if self.ended is not None:
            raise self.ended
        self._motions[row] = motion
        self._changed = True
        self._moved = self._moved or not setpoint

    def _phase(self, row: int) -> AgentPhase:
        return AgentPhase(int(self.tick.health.phase[row]))

    def _state(self, row: int) -> State:
        """Return where an agent should be, or is if that is not known."""
        if (motion := self._motions[row]) is not None:
            return motion.at(self.time)
        estimate = self.tick.estimate
        return Hold(estimate.position[row], float(estimate.yaw[row])).at(self.time)

    def _require_free(self, row: int, position: Array, name: str, line: str) -> None:
        """Raise `ScriptError` unless an agent can be at a position."""
        if not np.isfinite(position).all():
            raise ScriptError(f"{line}: {name}: {position.tolist()!r}, expected numbers")
        x, y, z = position.tolist()
        if fault := self.scene.world.fault((x, y, z)):
            raise ScriptError(f"{line}: {name}: {self.scene.names[row]} would leave: {fault}")

    def _step(self) -> None:
        """Fly a tick of the flight."""
        self._flight.step()

    def send_parameters(self) -> None:
        """Pass the parameters that the script has set to the flight."""
        parameters, self._parameters = self._parameters, []
        for agents, values in parameters:
            self._flight.set_parameters(values, agents)

    def _prepare(self) -> None:
        """Pass what the agents do in the next tick to the flight."""
        self.send_parameters()
        self._begin_climbs()
        commands, self._commands = self._commands, []
        for command in commands:
            self._flight.send(command)
        if self._changed:
            self._require_apart()
        time = self.time + self.scene.period  # of the next tick
        self._end_setpoints(time)
        n = len(self._motions)
        position, velocity = np.zeros((n, 3)), np.zeros((n, 3))
        acceleration, yaw, rate = np.full((n, 3), np.nan), np.zeros(n), np.full(n, np.nan)
        follows, steered = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        for row, motion in enumerate(self._motions):
            if motion is None:
                continue
            state = motion.at(time)
            position[row], velocity[row], yaw[row] = state.position, state.velocity, state.yaw
            acceleration[row], rate[row] = state.acceleration, state.yaw_rate
            if isinstance(motion, Steered):
                steered[row] = self._phase(row) is AgentPhase.FLYING
                if motion.height is not None:
                    away = motion.height - self.tick.estimate.position[row, 2]
                    velocity[row, 2] = HEIGHT_GAIN * away
            else:
                follows[row] = True
        if follows.any():
            speed = np.full(n, self.scene.limits.speed)
            fed_forward = np.isfinite(acceleration[follows]).any()
            ahead = (acceleration, rate) if fed_forward else (None, None)
            self._flight.set_goals(Goals(position, velocity, yaw, speed, follows, *ahead))
        if steered.any():
            self._flight.set_setpoint(Setpoint(velocity, yaw, steered))

    def _begin_climbs(self) -> None:
        """Command the take-offs of agents that are on the ground."""
        estimate = self.tick.estimate
        for row, (height, duration, line) in [*self._climbs.items()]:
            if self._phase(row) not in GROUND or not estimate.valid[row]:
                continue
            del self._climbs[row]
            top = estimate.position[[row]].copy()
            top[:, 2] = height
            yaw = estimate.yaw[[row]]
            self._commands.append(
                Command(Order.TAKEOFF, np.array([row]), top, yaw, np.array([duration]))
            )
            self._motions[row] = Hold(top[0], float(yaw[0]), line)
            self._changed = self._moved = True

    def _end_setpoints(self, time: float) -> None:
        """Let agents hover whose last setpoint is too old at a time, s."""
        for row, motion in enumerate(self._motions):
            if isinstance(motion, Streamed | Steered) and time > motion.end:
                state = motion.at(time)
                position = self.tick.estimate.position[row]
                self._motions[row] = Hold(position, state.yaw, motion.line)

    def _require_apart(self) -> None:
        """Raise `ScriptError` if agents would come too near each other as they are to move."""
        moving = [row for row, motion in enumerate(self._motions) if motion is not None]
        limits = self.scene.limits
        horizon = max((self._motions[row].end for row in moving), default=0.0) - self.time  # type: ignore[union-attr]
        most = MAX_HORIZON if self._moved else SETPOINT_HORIZON
        self._changed = self._moved = False
        if len(moving) < 2 or limits.separation <= 0:  # noqa: PLR2004 -- a pair
            return
        times = self.time + np.arange(0.0, min(max(horizon, 0.0), most) + SAMPLE, SAMPLE)
        path = np.array([[self._motions[row].at(t).position for t in times] for row in moving])  # type: ignore[union-attr]
        for i, row in enumerate(moving):
            for j in range(i):
                away = np.linalg.norm(path[i] - path[j], axis=1)
                near = np.flatnonzero((away < limits.separation) & (away < away[0] - RETREAT))
                if not len(near):
                    continue
                k, other = int(near[0]), moving[j]
                first, second = self._motions[other], self._motions[row]
                names = f"{self.scene.names[other]} and {self.scene.names[row]}"
                where = " and ".join(dict.fromkeys((first.line, second.line)))  # type: ignore[union-attr]
                raise ScriptError(
                    f"{where}: {names} would be {away[k]:.2f} m apart at {times[k]:.1f} s, "
                    f"expected limits.separation of {limits.separation:g} m at least"
                )


def _still(order: Order, rows: Sequence[int]) -> Command:
    """Return a command that has no position."""
    zero = np.zeros(len(rows))
    return Command(order, np.array(rows, np.int64), np.zeros((len(rows), 3)), zero, zero)


def script_line() -> str:
    """Return the line of the script that calls: ``file:line``."""
    frame = sys._getframe(1)  # noqa: SLF001 -- `inspect` is slow, and setpoints are streamed
    while frame.f_back is not None and frame.f_code.co_filename.startswith(OWN):
        frame = frame.f_back
    return f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"
