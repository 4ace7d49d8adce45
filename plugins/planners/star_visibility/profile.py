"""Heights of a path over and under obstacles: the shortest line that clears them."""

from __future__ import annotations

import math

import numpy as np

from star_core import Array
from star_core.toolkit import compiled
from star_visibility.openings import entered
from star_visibility.regions import Regions

SAME = 1e-9  # m; points nearer than this are equal


def profile(
    parts: Regions, span: Array, flat: Array, leg: Array, ends: tuple[float, float]
) -> Array:
    """Return the points of the shortest path over a polyline in the plane: (K, 3) m.

    It passes above blocks where the polyline's free height is above them, and below the others;
    elsewhere it climbs and descends evenly.

    Args:
        parts: Blocks.
        span: (G, 2) least and greatest height of each, m.
        flat: (M, 2) the polyline, m.
        leg: (M - 1,) free height of each of its segments, m.
        ends: Heights of the path's ends, m.
    """
    passed = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(flat, axis=0).T))])
    over = crossed(parts, span, flat, leg)
    if not len(over):
        climb = (ends[1] - ends[0]) * passed / max(passed[-1], SAME)
        return np.column_stack([flat, ends[0] + climb])
    at, low, high = _corridor(over, float(passed[-1]))
    where, z = np.array(_taut(at, low, high, ends)).T
    between = passed[(np.abs(passed[:, None] - where) > SAME).all(axis=1)]
    height = np.interp(between, where, z)
    order = np.argsort(np.concatenate([where, between]), kind="stable")
    where = np.concatenate([where, between])[order]
    x, y = (np.interp(where, passed, column) for column in flat.T)
    return np.column_stack([x, y, np.concatenate([z, height])[order]])


def _corridor(over: Array, length: float) -> tuple[Array, Array, Array]:
    """Return the positions at which the height limits change: (K + 1,) m, and both: (K,) m each."""
    cuts = np.unique(np.concatenate([[0.0, length], np.clip(over[:, :2].ravel(), 0.0, length)]))
    keep = np.concatenate([[True], np.diff(cuts) > SAME])
    at = cuts[keep]
    if len(at) > 1:
        at[-1] = length
    middle = (at[:-1] + at[1:]) / 2
    inside = (over[:, :1] < middle) & (middle < over[:, 1:2])  # (C, K)
    low = np.where(inside, over[:, 2:3], -np.inf).max(axis=0, initial=-np.inf)
    high = np.where(inside, over[:, 3:4], np.inf).min(axis=0, initial=np.inf)
    return at, low, high


def _taut(
    at: Array, low: Array, high: Array, ends: tuple[float, float]
) -> list[tuple[float, float]]:
    """Return the turns of a string pulled tight through a corridor, including its ends.

    Where the corridor permits only vertical motion, the string is vertical.
    """
    gates: list[tuple[float, float, float]] = []
    for s, (below, above), (least, most) in zip(
        at[1:-1].tolist(),
        zip(low[:-1].tolist(), high[:-1].tolist(), strict=True),
        zip(low[1:].tolist(), high[1:].tolist(), strict=True),
        strict=True,
    ):
        if max(below, least) <= min(above, most):
            gates.append((s, max(below, least), min(above, most)))
        else:
            edge, bound = (below, most) if below > most else (above, least)
            gates += [(s, edge, edge), (s, bound, bound)]
    start = (float(at[0]), ends[0])
    if len(low) and not low[0] <= ends[0] <= high[0]:
        gates.insert(0, (start[0], *2 * (float(np.clip(ends[0], low[0], high[0])),)))
    if len(low) and not low[-1] <= ends[1] <= high[-1]:
        gates.append((float(at[-1]), *2 * (float(np.clip(ends[1], low[-1], high[-1])),)))
    gates.append((float(at[-1]), ends[1], ends[1]))
    string = [start]
    k = 0
    while k < len(gates):
        s, z = string[-1]
        if gates[k][0] <= s:
            if gates[k][1] != z:
                string.append((s, gates[k][1]))
            k += 1
            continue
        k, turn = _next_turn(gates, k, s, z)
        string.append(turn)
    return string


def _next_turn(
    gates: list[tuple[float, float, float]], k: int, s: float, z: float
) -> tuple[int, tuple[float, float]]:
    """Return the first gate after the string's next turn, and that turn."""
    least, greatest = -math.inf, math.inf  # slopes that pass all gates so far
    floor = ceiling = k
    for j in range(k, len(gates)):
        at, low, high = gates[j]
        below, above = (low - z) / (at - s), (high - z) / (at - s)
        if below > greatest:
            return ceiling + 1, (gates[ceiling][0], gates[ceiling][2])
        if above < least:
            return floor + 1, (gates[floor][0], gates[floor][1])
        if low == high:
            return j + 1, (at, low)
        if below >= least:
            least, floor = below, j
        if above <= greatest:
            greatest, ceiling = above, j
    raise AssertionError  # the last gate is a point


@compiled
def crossed(parts: Regions, span: Array, flat: Array, leg: Array) -> Array:
    """Return where a polyline passes over or under a block, and its free heights there.

    Returns:
        (C, 4) begin and end along the polyline, least and greatest height, m.
    """
    crossings = np.empty((len(span) * len(leg), 4))
    count, passed = 0, 0.0
    for k in range(len(leg)):
        ax, ay, bx, by = flat[k, 0], flat[k, 1], flat[k + 1, 0], flat[k + 1, 1]
        for part in range(len(span)):
            ends = entered(parts, part, ax, ay, bx, by)
            if ends[0] < np.inf:
                over = leg[k] >= (span[part, 0] + span[part, 1]) / 2
                crossings[count, 0], crossings[count, 1] = passed + ends[0], passed + ends[1]
                crossings[count, 2] = span[part, 1] if over else -np.inf
                crossings[count, 3] = np.inf if over else span[part, 0]
                count += 1
        passed += math.hypot(bx - ax, by - ay)
    answer: Array = crossings[:count]
    return answer
