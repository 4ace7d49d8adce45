"""The Kalman filter of each agent: odometry moves the state, measured poses correct it.

The state of an agent is its position and yaw in the map, the error of its odometry's velocity in
the plane, and the error of the positioning system. Both errors are first-order Gauss-Markov
processes, so the filter neither averages away a measurement error that lasts nor trusts odometry
whose scale is wrong: Gelb, "Applied Optimal Estimation" (1974), 4.5, augments a state likewise.
"""

from __future__ import annotations

import math

import numpy as np

from star_core import Array, Rows
from star_core.toolkit import compiled, subroutine
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
TWO_PI = 2 * math.pi


@compiled
def move(
    state: Array, covariance: Array, history: Array, count: Rows, report: Array, error: Array
) -> None:
    """Move every agent with a new report; in place.

    Args:
        state: (N, 9) of each agent, map frame.
        covariance: (N, 9, 9) of it.
        history: (N, HISTORY, 8) reports of each agent, the newest at ``count % HISTORY - 1``.
        count: (N,) number of its reports so far.
        report: (N, 8) newest report of each agent; NaN where there is none.
        error: (N, 2) standard deviation, m, and correlation time, s, of its measured positions.
    """
    for i in range(len(state)):
        now = report[i, TIME]
        if not math.isfinite(report[i].sum()):
            continue
        newest = (count[i] - 1) % HISTORY
        if count[i] > 0 and now <= history[i, newest, TIME]:
            continue
        if count[i] > 0:
            _move(state[i], covariance[i], history[i, newest], report[i], error[i])
        history[i, count[i] % HISTORY] = report[i]
        count[i] += 1


@compiled
def correct(
    state: Array,
    covariance: Array,
    history: Array,
    count: Rows,
    error: Array,
    fix_agent: Rows,
    fix: Array,
) -> None:
    """Correct the agents that were measured; in place.

    Args:
        state: As for `move`, like the next four.
        covariance: As for `move`.
        history: As for `move`.
        count: As for `move`.
        error: As for `move`.
        fix_agent: (K,) row of each measurement, in the order of their times.
        fix: (K, 9) time, x, y, z, yaw (NaN if not measured), the standard deviations of position
            and yaw, correlation time, and the variance by which an uncertain time adds to the
            position's, m².
    """
    gain, column = np.empty(STATES), np.empty(STATES)
    for k in range(len(fix_agent)):
        i = fix_agent[k]
        if count[i] == 0:
            continue
        _correct(state[i], covariance[i], history[i], count[i], error[i], fix[k], gain, column)


@compiled
def positions_at(state: Array, history: Array, count: Rows, time: float) -> Array:
    """Return where the agents were at a time, s: (N, 3) m; NaN for those without a report.

    A time before all reports in the history counts as that of the first one.
    """
    positions = np.full((len(state), 3), np.nan)
    for i in range(len(state)):
        if count[i] > 0:
            newest = (count[i] - 1) % HISTORY
            oldest = count[i] % HISTORY if count[i] > HISTORY else 0
            qx, qy, qz, _, _ = _flown_since(
                history[i], count[i], max(time, history[i, oldest, TIME])
            )
            turn = state[i, YAW] - history[i, newest, HEADING]
            cos, sin = math.cos(turn), math.sin(turn)
            positions[i, 0] = state[i, X] - (cos * qx - sin * qy)
            positions[i, 1] = state[i, Y] - (sin * qx + cos * qy)
            positions[i, 2] = state[i, Z] - qz
    return positions


@subroutine
def _move(x: Array, p: Array, last: Array, report: Array, error: Array) -> None:
    """Predict a state and its covariance from one report to the next."""
    period = report[TIME] - last[TIME]
    turn = x[YAW] - last[HEADING]  # from the odometry frame to the map
    cos, sin = math.cos(turn), math.sin(turn)
    qx, qy, qz = report[QX] - last[QX], report[QY] - last[QY], report[QZ] - last[QZ]
    dx, dy = cos * qx - sin * qy, sin * qx + cos * qy
    turned = (report[HEADING] - last[HEADING] + math.pi) % TWO_PI - math.pi
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
def _correct(
    x: Array,
    p: Array,
    history: Array,
    count: int,
    error: Array,
    fix: Array,
    gain: Array,
    column: Array,
) -> None:
    """Correct a state by a measured pose, compared with where the agent was at its time."""
    if error[0] != fix[5] or error[1] != fix[7] or fix[7] == 0.0:
        _new_error(x, p, error, fix)
    newest = (count - 1) % HISTORY
    since = history[newest, TIME] - fix[0]
    qx, qy, qz, turned, early = _flown_since(history, count, fix[0])
    if early:
        return
    turn = x[YAW] - history[newest, HEADING]
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
        _update(x, p, column, variance, fix[1 + axis] - expected, gain)
    if math.isfinite(fix[4]):
        surprise = (fix[4] - x[YAW] + turned + math.pi) % TWO_PI - math.pi
        for k in range(STATES):
            column[k] = p[k, YAW]
        _update(x, p, column, column[YAW] + max(fix[6] * fix[6], FLOOR), surprise, gain)


@subroutine
def _new_error(x: Array, p: Array, error: Array, fix: Array) -> None:
    """Forget the error of the positioning system: the next one is independent of it."""
    error[0], error[1] = fix[5], fix[7]
    for k in range(ERROR, STATES):
        for m in range(STATES):
            p[k, m] = 0.0
            p[m, k] = 0.0
        p[k, k] = fix[5] * fix[5]
        x[k] = 0.0


@subroutine
def _flown_since(
    history: Array, count: int, time: float
) -> tuple[float, float, float, float, bool]:
    """Return how far an agent has flown and turned from a time to its newest report.

    Returns:
        x, y, z in the odometry frame, m; angle, rad; and whether the time is before all reports.
    """
    newest = (count - 1) % HISTORY
    at = newest
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
        turned -= share * ((step + math.pi) % TWO_PI - math.pi)
    return qx, qy, qz, turned, rest < -ROUNDING


@subroutine
def _update(
    x: Array, p: Array, column: Array, variance: float, surprise: float, gain: Array
) -> None:
    """Correct a state by one number: `column` is its covariance with the state."""
    for k in range(STATES):
        gain[k] = column[k] / variance
    for k in range(STATES):
        x[k] += gain[k] * surprise
        for m in range(STATES):
            p[k, m] -= gain[k] * column[m]
