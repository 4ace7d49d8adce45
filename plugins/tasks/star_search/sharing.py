"""A tour of lanes, shared among scouts so that all are done at one time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from star_core import Array
from star_search.lanes import SHORTEST, Lane, length


def cut(lanes: Sequence[Lane], shares: int) -> list[list[Lane]]:
    """Return a tour in so many pieces of one length; a lane may be cut in two.

    No agent flies the way from one piece to the next, so the pieces that begin with one come
    out a little shorter.

    Args:
        lanes: In order.
        shares: How many pieces.
    """
    each = length(lanes) / shares
    pieces: list[list[Lane]] = [[]]
    flown = 0.0  # of the piece, with the way to its next lane
    for k, whole in enumerate(lanes):
        lane = whole
        if k and pieces[-1]:
            flown += math.dist(lanes[k - 1].end, lane.start)
        while flown + lane.length > each + SHORTEST and len(pieces) < shares:
            keep = each - flown
            if keep >= SHORTEST:
                middle = lane.start + (lane.end - lane.start) * (keep / lane.length)
                pieces[-1].append(Lane(lane.start, middle))
                lane = Lane(middle, lane.end)
            pieces.append([])
            flown = 0.0
        pieces[-1].append(lane)
        flown += lane.length
    return pieces + [[] for _ in range(shares - len(pieces))]


def hand_out(pieces: Sequence[list[Lane]], position: Array) -> list[list[Lane]]:
    """Return each agent's piece, turned round where its end is nearer than its start.

    The ways there add up to least.

    Args:
        pieces: As many as agents.
        position: (K, 2) where the agents are, m.
    """
    ways = np.zeros((len(position), len(pieces)))
    for j, piece in enumerate(pieces):
        if piece:
            ends = np.array([piece[0].start, piece[-1].end])
            ways[:, j] = np.hypot(*(position[:, None] - ends).transpose(2, 0, 1)).min(axis=1)
    given = []
    for place, whose in zip(position, linear_sum_assignment(ways)[1].tolist(), strict=True):
        piece = pieces[whose]
        given.append(turned(piece) if piece and _nearer_end(piece, place) else list(piece))
    return given


def turned(piece: Sequence[Lane]) -> list[Lane]:
    """Return a piece the other way round."""
    return [lane.reversed() for lane in reversed(piece)]


def _nearer_end(piece: Sequence[Lane], place: Array) -> bool:
    return math.dist(piece[-1].end, place) < math.dist(piece[0].start, place)
