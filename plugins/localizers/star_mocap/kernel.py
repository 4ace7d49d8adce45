"""The Kalman filter of each agent: odometry moves the state, measured poses correct it.

The state of an agent is its position and yaw in the map, the error of its odometry's velocity in
the plane, and the error of the positioning system. Both errors are first-order Gauss-Markov
processes, so the filter neither averages away a measurement error that lasts nor trusts odometry
whose scale is wrong: Gelb, "Applied Optimal Estimation" (1974), 4.5, augments a state likewise.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from star_core import Array, Rows
from star_core.toolkit import compiled, subroutine, wrap_angle
from star_mocap.odometry import SLIP, SLIP_SHARE, SLIP_TIME, WALK, YAW_WALK

# The state, and columns of the history of reports.
X, Y, Z, YAW, SLIP_X, SLIP_Y, ERROR = range(7)  # m, m, m, rad, m/s, m/s, and from there 3 x m
STATES = 9
TIME, QX, QY, QZ, VX, VY, VZ, HEADING = range(8)  # s, then m, m/s and rad in the odometry frame
COLUMNS = 8
HISTORY = 32  # reports: 1.6 s at 20 Hz, within which a measurement must arrive

CLIMB_WALK = 0.02**2  # m²/s
STEP_UP = 0.05  # m, by which a height jumps over an edge that the ranger sees
FLOOR = 1e-8  # m² or rad², least variance of a measurement
ROUNDING = 1e-6  # s

FILTER: Final = np.dtype(
    [
        ("state", "f8", STATES),
        ("covariance", "f8", (STATES, STATES)),
        ("history", "f8", (HISTORY, COLUMNS)),  # reports, the newest at ``count % HISTORY - 1``
        ("count", "i8"),  # reports so far
        ("error", "f8", 2),  # m and s: standard deviation and correlation time of measurements
    ],
    align=True,
)

wrap = subroutine(wrap_angle)  # callable from kernels


@compiled
def move(filters: Any, report: Array) -> None:
    """Move every agent with a new report.

    Args:
        filters: (N,) records of `FILTER`, changed in place.
        report: (N, 8) newest report of each agent; NaN where there is none.
    """
    for i in range(len(filters)):
        agent, now = filters[i], report[i, TIME]
        if not math.isfinite(report[i].sum()):
            continue
        newest = (agent.count - 1) % HISTORY
        if agent.count > 0 and now <= agent.history[newest, TIME]:
            continue
        if agent.count > 0:
            _move(agent, agent.history[newest], report[i])
        agent.history[agent.count % HISTORY] = report[i]
        agent.count += 1


@compiled
def correct(filters: Any, fix_agent: Rows, fix: Array) -> None:
    """Correct the agents that were measured.

    Args:
        filters: (N,) records of `FILTER`, changed in place.
        fix_agent: (K,) row of each measurement, in the order of their times.
        fix: (K, 9) time, x, y, z, yaw (NaN if not measured), the standard deviations of position
            and yaw, correlation time, and the variance by which an uncertain time adds to the
            position's, m².
    """
    gain, column = np.empty(STATES), np.empty(STATES)
    for k in range(len(fix_agent)):
        agent = filters[fix_agent[k]]
        if agent.count > 0:
            _correct(agent, fix[k], gain, column)


@compiled
def positions_at(filters: Any, time: float) -> Array:
    """Return where the agents were at a time, s: (N, 3) m; NaN for those without a report.

    A time before all reports in the history counts as that of the first one.
    """
    positions = np.full((len(filters), 3), np.nan)
    for i in range(len(filters)):
        agent = filters[i]
        state, count = agent.state, agent.count
        if count > 0:
            newest = (count - 1) % HISTORY
            oldest = count % HISTORY if count > HISTORY else 0
            qx, qy, qz, _, _ = _flown_since(agent, max(time, agent.history[oldest, TIME]))
            turn = state[YAW] - agent.history[newest, HEADING]
            cos, sin = math.cos(turn), math.sin(turn)
            positions[i, 0] = state[X] - (cos * qx - sin * qy)
            positions[i, 1] = state[Y] - (sin * qx + cos * qy)
            positions[i, 2] = state[Z] - qz
    return positions


@subroutine
def _move(agent: Any, last: Array, report: Array) -> None:
    """Predict a state and its covariance from one report to the next."""
    x, p, error = agent.state, agent.covariance, agent.error
    period = report[TIME] - last[TIME]
    turn = x[YAW] - last[HEADING]  # from the odometry frame to the map
    cos, sin = math.cos(turn), math.sin(turn)
    qx, qy, qz = report[QX] - last[QX], report[QY] - last[QY], report[QZ] - last[QZ]
    dx, dy = cos * qx - sin * qy, sin * qx + cos * qy
    turned = wrap(report[HEADING] - last[HEADING])
    slip_kept = math.exp(-period / SLIP_TIME)
    error_kept = math.exp(-period / error[1]) if error[1] > 0.0 else 0.0
    x[X] += dx + period * x[SLIP_X]
    x[Y] += dy + period * x[SLIP_Y]
    x[Z] += qz
    x[YAW] += turned
    for k in range(STATES):  # rows of F P
        p[X, k] += -dy * p[YAW, k] + period * p[SLIP_X, k]
        p[Y, k] += dx * p[YAW, k] + period * p[SLIP_Y, k]
    for k in range(STATES):  # columns of F P F'
        p[k, X] += -dy * p[k, YAW] + period * p[k, SLIP_X]
        p[k, Y] += dx * p[k, YAW] + period * p[k, SLIP_Y]
    for k in range(SLIP_X, STATES):
        kept = slip_kept if k < ERROR else error_kept
        x[k] *= kept
        for m in range(STATES):
            p[k, m] *= kept
            p[m, k] *= kept
    jump = abs(qz - period * report[VZ])
    speed = math.sqrt(qx * qx + qy * qy) / max(period, 1e-3)
    slip = SLIP + SLIP_SHARE * speed
    p[X, X] += WALK * period
    p[Y, Y] += WALK * period
    p[Z, Z] += CLIMB_WALK * period + (jump * jump if jump > STEP_UP else 0.0)
    p[YAW, YAW] += YAW_WALK * period
    for k in range(SLIP_X, ERROR):
        p[k, k] += slip * slip * (1.0 - slip_kept * slip_kept)
    for k in range(ERROR, STATES):
        p[k, k] += error[0] * error[0] * (1.0 - error_kept * error_kept)


@subroutine
def _correct(agent: Any, fix: Array, gain: Array, column: Array) -> None:
    """Correct a state by a measured pose, compared with where the agent was at its time."""
    x, p = agent.state, agent.covariance
    if agent.error[0] != fix[5] or agent.error[1] != fix[7] or fix[7] == 0.0:
        _new_error(agent, fix)
    newest = (agent.count - 1) % HISTORY
    since = agent.history[newest, TIME] - fix[0]
    qx, qy, qz, turned, early = _flown_since(agent, fix[0])
    if early:
        return
    turn = x[YAW] - agent.history[newest, HEADING]
    cos, sin = math.cos(turn), math.sin(turn)
    dx, dy = cos * qx - sin * qy, sin * qx + cos * qy
    for axis in range(3):
        flown, by_yaw, by_slip = (dx, dy, since) if axis == X else (dy, -dx, since)
        slip = SLIP_X + axis
        if axis == Z:
            flown, by_yaw, by_slip, slip = qz, 0.0, 0.0, SLIP_X
        expected = x[axis] + x[ERROR + axis] - flown - by_slip * x[slip]
        for k in range(STATES):
            column[k] = p[k, axis] + p[k, ERROR + axis] + by_yaw * p[k, YAW] - by_slip * p[k, slip]
        variance = column[axis] + column[ERROR + axis] + by_yaw * column[YAW]
        variance += FLOOR + fix[8] - by_slip * column[slip]
        _update(agent, column, variance, fix[1 + axis] - expected, gain)
    if math.isfinite(fix[4]):
        surprise = wrap(fix[4] - x[YAW] + turned)
        for k in range(STATES):
            column[k] = p[k, YAW]
        _update(agent, column, column[YAW] + max(fix[6] * fix[6], FLOOR), surprise, gain)


@subroutine
def _new_error(agent: Any, fix: Array) -> None:
    """Forget the error of the positioning system: the next one is independent of it."""
    x, p = agent.state, agent.covariance
    agent.error[0], agent.error[1] = fix[5], fix[7]
    for k in range(ERROR, STATES):
        for m in range(STATES):
            p[k, m] = 0.0
            p[m, k] = 0.0
        p[k, k] = fix[5] * fix[5]
        x[k] = 0.0


@subroutine
def _flown_since(agent: Any, time: float) -> tuple[float, float, float, float, bool]:
    """Return how far an agent has flown and turned from a time to its newest report.

    Returns:
        x, y, z in the odometry frame, m; angle, rad; and whether the time is before all reports.
    """
    history, count = agent.history, agent.count
    at = newest = (count - 1) % HISTORY
    for back in range(1, min(count, HISTORY)):
        if history[at, TIME] <= time:
            break
        at = (newest - back) % HISTORY
    rest = time - history[at, TIME]
    qx = history[newest, QX] - history[at, QX]
    qy = history[newest, QY] - history[at, QY]
    qz = history[newest, QZ] - history[at, QZ]
    turned = history[newest, HEADING] - history[at, HEADING]
    if at == newest:  # newer than all reports
        qx -= rest * history[at, VX]
        qy -= rest * history[at, VY]
        qz -= rest * history[at, VZ]
    else:
        after = (at + 1) % HISTORY
        share = rest / (history[after, TIME] - history[at, TIME])
        qx -= share * (history[after, QX] - history[at, QX])
        qy -= share * (history[after, QY] - history[at, QY])
        qz -= share * (history[after, QZ] - history[at, QZ])
        step = history[after, HEADING] - history[at, HEADING]
        turned -= share * wrap(step)
    return qx, qy, qz, turned, rest < -ROUNDING


@subroutine
def _update(agent: Any, column: Array, variance: float, surprise: float, gain: Array) -> None:
    """Correct a state by one number: `column` is its covariance with the state."""
    x, p = agent.state, agent.covariance
    for k in range(STATES):
        gain[k] = column[k] / variance
    for k in range(STATES):
        x[k] += gain[k] * surprise
        for m in range(STATES):
            p[k, m] -= gain[k] * column[m]
