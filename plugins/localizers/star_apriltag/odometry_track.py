"""One agent's odometry: read, integrated, and corrected by better measurements."""

from __future__ import annotations

import cmath
import math
from typing import Final, NamedTuple

import numpy as np

from star_core import Array, Odometry, Rows, Telemetry, Transform
from star_core.toolkit import wrap_angle

CAPACITY: Final = 1 << 13  # samples: 82 s at 100 Hz, well beyond the longest gap between fixes
COLUMNS: Final = 12
"""Time, velocity, yaw rate, roll, pitch, height, whether blind, whether at rest, and velocity by
`LaggedTurn` as real and imaginary parts."""

TILT_SAMPLES: Final = 2  # before and after one, by which roll and pitch are differentiated

MAX_REST_SPEED: Final = 0.05  # m/s, of an agent at rest with its motors off
MAX_REST_RATE: Final = math.radians(3.0)  # rad/s, likewise

# How an estimator on board corrects its velocity (1/s) and, by its tilt, its acceleration (1/s²)
# by the difference between the flow sensor and itself: what the firmware's filter settles at.
VELOCITY_CORRECTION: Final = 2.84
TILT_CORRECTION: Final = 2.94
MAX_LAG_STEP: Final = 0.5  # s between two samples; after a longer gap no lag is assumed


class Motion(NamedTuple):
    """A motion from one time to a later one, relative to its start."""

    shift: complex  # displacement in x and y of the start's level body frame, m, as x + iy
    turn: float  # change of yaw, rad
    length: float  # of the path, m
    duration: float  # without the time at rest, s
    blind_length: float  # length that only the flow sensor measured, m
    blind_duration: float  # likewise, s
    blind_shift: complex = 0j  # share of the displacement that only the flow sensor measured, m
    moment: complex = 0j  # integral of the time since the start over the displacement, m s
    swing: complex = 0j
    """Displacement of a point 1 m ahead by `LaggedTurn`, while only the flow sensor measured, m; by
    the yaw rate as measured."""
    height: float = 0.0  # z in the odometry frame, at the end, m


class OdometrySample(NamedTuple):
    """Attitude, height and motion of the agent at one time."""

    roll: float  # rad
    pitch: float  # rad, nose down positive
    height: float  # z in the odometry frame, m
    velocity: Array  # (3,) in the level body frame, m/s
    yaw_rate: float  # rad/s
    tilt_rate: tuple[float, float] = (0.0, 0.0)  # of roll and pitch, rad/s
    swing: complex = 0j  # lagged velocity of a point 1 m ahead in the body, m/s


class OdometryTrack:
    """Keeps the samples of one agent in order of time, and integrates them.

    A sample is valid from the one before it to its own time. Samples that are not newer than the
    last one, or not finite, are ignored. An agent at rest does not move: its sensors then show
    their bias, which need not be that of the flight.
    """

    def __init__(self) -> None:
        self._rows = np.zeros((2 * CAPACITY, COLUMNS))
        self._end = 0
        self._turn = LaggedTurn()

    def add(self, odometry: Odometry, rows: Rows, *, motors: bool = True) -> None:
        """Add the samples in `rows` of `odometry`.

        Args:
            odometry: With the agent's samples.
            rows: Of the agent.
            motors: Whether its motors may run; off, it is at rest unless it is carried.
        """
        table = np.zeros((len(rows), COLUMNS))
        table[:, 0] = odometry.time[rows]
        table[:, 1:4] = odometry.velocity[rows]
        table[:, 4] = odometry.yaw_rate[rows]
        table[:, 5] = odometry.roll[rows]
        table[:, 6] = odometry.pitch[rows]
        table[:, 7] = odometry.height[rows]
        table[:, 8] = 1.0
        if not motors:
            slow = np.abs(table[:, 1:4]).max(axis=1, initial=0.0) < MAX_REST_SPEED
            table[:, 9] = slow & (np.abs(table[:, 4]) < MAX_REST_RATE)
        table = table[np.isfinite(table).all(axis=1)]
        newer = np.maximum.accumulate(np.append(self.newest, table[:-1, 0])) < table[:, 0]
        table = table[newer][-CAPACITY:]
        swings = map(self._turn.follow, table[:, 0].tolist(), table[:, 4].tolist())
        for row, swing in zip(table, swings, strict=True):
            row[10], row[11] = swing.real, swing.imag
        self._make_room(len(table))
        self._rows[self._end : self._end + len(table)] = table
        self._end += len(table)

    @property
    def newest(self) -> float:
        """Time of the newest sample, s; -inf if there is none."""
        return float(self._rows[self._end - 1, 0]) if self._end else -np.inf

    def between(
        self, begin: float, end: float, *, scale: complex = 1.0, yaw_bias: float = 0.0
    ) -> Motion:
        """Integrate from `begin` to `end`, s; the newest sample's motion continues after it.

        Args:
            begin: s.
            end: s, no earlier than `begin`.
            scale: Factor of the flow sensor's velocities: its scale and misalignment.
            yaw_bias: Subtracted from the yaw rate, rad/s.
        """
        times = self._rows[: self._end, 0]
        if end <= begin or not len(times):
            duration = max(0.0, end - begin)
            return Motion(0j, 0.0, 0.0, duration, 0.0, duration)
        first = min(int(times.searchsorted(begin, side="right")), len(times) - 1)
        last = min(int(times.searchsorted(end)), len(times) - 1)
        rows = self._rows[first : last + 1]
        until = np.empty(len(rows) + 1)
        until[0], until[-1] = begin, end
        np.minimum(np.maximum(rows[:-1, 0], begin), end, out=until[1:-1])
        took = (until[1:] - until[:-1]) * (1 - rows[:, 9])
        turns = (rows[:, 4] - yaw_bias) * took
        after = turns.cumsum()
        blind = rows[:, 8]
        steps = np.where(blind > 0, scale, 1.0) * (rows[:, 1] + 1j * rows[:, 2]) * took
        lengths = np.abs(steps)
        toward = np.exp(1j * (after - turns / 2))
        turned = toward * steps
        middle = took.cumsum() - took / 2  # s, of each sample's motion
        uncorrected = toward * np.exp(1j * yaw_bias * middle)  # headings by the rate as measured
        return Motion(
            shift=complex(turned.sum()),
            turn=float(after[-1]),
            length=float(lengths.sum()),
            duration=float(took.sum()),
            blind_length=float(lengths @ blind),
            blind_duration=float(took @ blind),
            blind_shift=complex(turned @ blind),
            moment=complex(middle @ turned),
            height=float(rows[-1, 7]),
            swing=complex((uncorrected * (rows[:, 10] + 1j * rows[:, 11])) @ (took * blind)),
        )

    def correct(self, begin: float, end: float, shift: complex, *, yaw_bias: float) -> None:
        """Replace the displacement between two times by a better measurement.

        All velocities in the body change by the same amount; turns do not change. Without samples
        up to `end`, nothing changes.

        Args:
            begin: s.
            end: s.
            shift: As `between` returns it for these times and this yaw bias, m.
            yaw_bias: Subtracted from the yaw rate, rad/s.
        """
        if not begin < end <= self.newest:
            return
        self._make_room(2)
        rows = self._rows[self._cut(begin) : self._cut(end)]
        took = np.diff(rows[:, 0], prepend=begin)
        turns = (rows[:, 4] - yaw_bias) * took
        turned = np.exp(1j * (np.cumsum(turns) - turns / 2)) * took
        more = complex((shift - turned @ (rows[:, 1] + 1j * rows[:, 2])) / turned.sum())
        rows[:, 1] += more.real
        rows[:, 2] += more.imag
        rows[:, 8:] = 0.0

    def _cut(self, time: float) -> int:
        """Split a sample at `time`, s, no later than the newest; return the row after it."""
        row = int(np.searchsorted(self._rows[: self._end, 0], time))
        if self._rows[row, 0] != time:
            self._rows[row + 1 : self._end + 1] = self._rows[row : self._end].copy()
            self._rows[row, 0] = time
            self._end += 1
        return row + 1

    def _make_room(self, more: int) -> None:
        """Drop old samples if there is no room for that many more."""
        if self._end + more > len(self._rows):
            kept = self._rows[self._end - CAPACITY : self._end].copy()
            self._end = len(kept)
            self._rows[: self._end] = kept

    def at(self, time: float) -> OdometrySample:
        """Return the sample that is valid at `time`, s; level and at rest if there is none."""
        times = self._rows[: self._end, 0]
        if not len(times):
            return OdometrySample(0.0, 0.0, 0.0, np.zeros(3), 0.0)
        k = min(int(np.searchsorted(times, time)), len(times) - 1)
        row = self._rows[k]
        roll, pitch, height = row[5:8].tolist()
        around = self._rows[max(k - TILT_SAMPLES, 0) : min(k + TILT_SAMPLES + 1, self._end)]
        took = max(float(around[-1, 0] - around[0, 0]), MIN_INTERVAL)
        turned = ((around[-1, 5:7] - around[0, 5:7]) / took).tolist()
        swing = complex(row[10], row[11])
        rate = float(row[4])
        return OdometrySample(roll, pitch, height, row[1:4], rate, (turned[0], turned[1]), swing)


class LaggedTurn:
    """Follows how an error that is constant in the body shows in an estimate, as the body turns.

    A constant error of the accelerometer is balanced by an error of the estimated tilt. When the
    body turns, that tilt is wrong until the flow sensor has corrected it, within a second: the
    estimated position moves as a point of the body would, but later. In the map, the velocity ``w``
    of a point 1 m ahead, with heading ``psi``, follows ``dw/dt = q - k w`` and ``dq/dt = t (d/dt
    exp(i psi) - w)``, with `VELOCITY_CORRECTION` ``k`` and `TILT_CORRECTION` ``t``.
    """

    def __init__(self) -> None:
        self._time = -math.inf
        self._swing = self._push = 0j  # in the level body frame: m/s and m/s²

    def follow(self, time: float, yaw_rate: float) -> complex:
        """Return the lagged velocity in the level body frame, m/s, after a sample.

        Args:
            time: s, later than the last.
            yaw_rate: Since the last, rad/s.
        """
        took, self._time = time - self._time, time
        if took > MAX_LAG_STEP:
            self._swing = self._push = 0j
            return 0j
        back = cmath.rect(1.0, -yaw_rate * took)
        self._swing *= back
        self._push = back * self._push + TILT_CORRECTION * (1 - back - took * self._swing)
        self._swing += took * (self._push - VELOCITY_CORRECTION * self._swing)
        return self._swing


MAX_SILENCE: Final = 0.5  # s without a sample, after which reports replace the stream
MIN_INTERVAL: Final = 1e-6  # s between two reports; less is one report, repeated


class ReportOdometry:
    """Completes the odometry stream; `silent` has the agents whose samples are from reports."""

    def __init__(self, agents: int) -> None:
        self.silent: set[int] = set()
        self._streamed = np.full(agents, -np.inf)  # s, time of the last sample
        self._time = np.full(agents, np.nan)  # s, of the last report with a heading
        self._heading = np.zeros(agents)
        self._rate = np.zeros(agents)

    def complete(self, telemetry: Telemetry) -> Odometry:
        """Return the stream with a sample for each agent that has not streamed for a while.

        The sample has the time of the agent's report. Its yaw rate is the mean since the previous
        report.
        """
        streamed = telemetry.odometry
        now = telemetry.time
        self._streamed[streamed.agent] = now
        reported = now - telemetry.age
        heading = telemetry.heading
        passed = reported - self._time
        newer = np.isfinite(heading) & ~(passed <= MIN_INTERVAL)  # the first report is newer too
        turned = wrap_angle(heading - self._heading)
        rate = np.where(np.isfinite(passed), turned, 0.0)
        rate /= np.where(passed > MIN_INTERVAL, passed, 1.0)
        self._rate = np.where(newer, rate, self._rate)
        self._time = np.where(newer, reported, self._time)
        self._heading = np.where(newer, heading, self._heading)
        silent = np.flatnonzero(now - self._streamed > MAX_SILENCE)
        self.silent = set(silent.tolist())
        if not len(silent):
            return streamed
        level = Transform(heading[silent], np.zeros((len(silent), 3)))
        x, y, z, w = telemetry.attitude[silent].T
        samples = {
            "agent": silent,
            "time": reported[silent],
            "velocity": level.turn_back(telemetry.velocity[silent]),
            "yaw_rate": self._rate[silent],
            "roll": np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            "pitch": np.arcsin(np.clip(2 * (w * y - z * x), -1, 1)),
            "height": telemetry.position[silent, 2],
        }
        return Odometry(
            **{
                name: np.concatenate([getattr(streamed, name), sample])
                for name, sample in samples.items()
            }
        )
