"""Uploaded trajectories against numpy's polynomials, and against the format that cflib writes."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import polynomial

from star_fleet.trajectory import bezier, compressed, plain
from star_sim.pieces import Piece

coefficients = st.lists(st.floats(-2, 2), min_size=32, max_size=32)
durations = st.floats(0.25, 4)
fractions = st.floats(0, 1)


def piece_bytes(values: list[float], duration: float) -> bytes:
    return struct.pack("<33f", *values, duration)


@given(coefficients, durations, fractions)
def test_a_plain_piece_is_numpys_polynomial(
    values: list[float], duration: float, fraction: float
) -> None:
    exact = np.array(struct.unpack("<33f", piece_bytes(values, duration)))
    (piece,) = plain(piece_bytes(values, duration), 0, 1) or []
    time = fraction * piece.duration
    for k, derivative in enumerate(piece.at(time)):
        for axis in range(4):
            derived = polynomial.polyder(exact[8 * axis : 8 * axis + 8], k)
            expected = polynomial.polyval(time, derived)
            assert derivative[axis] == pytest.approx(expected, rel=1e-6, abs=1e-6 * 4**7)


@given(coefficients, durations, fractions)
def test_reversed_pieces_mirror_time(values: list[float], duration: float, fraction: float) -> None:
    piece = Piece(np.reshape(values, (4, 8)), duration)
    point = piece.backwards().at(fraction * duration)[0]
    assert point == pytest.approx(piece.at((1 - fraction) * duration)[0], abs=1e-9)


@given(coefficients, st.floats(0.5, 4), fractions)
def test_a_slower_piece_is_at_the_same_place_later(
    values: list[float], factor: float, fraction: float
) -> None:
    piece = Piece(np.reshape(values, (4, 8)), 2.0)
    place, rate, _ = piece.slower(factor).at(2.0 * factor * fraction)
    assert place == pytest.approx(piece.at(2.0 * fraction)[0], abs=1e-9)
    assert rate * factor == pytest.approx(piece.at(2.0 * fraction)[1], abs=1e-7)


@given(st.lists(st.floats(-2, 2), min_size=1, max_size=8), fractions)
def test_a_bezier_curve_is_de_casteljaus(points: list[float], fraction: float) -> None:
    row = np.array(points)
    while len(row) > 1:
        row = (1 - fraction) * row[:-1] + fraction * row[1:]
    assert polynomial.polyval(fraction, bezier(points)) == pytest.approx(row[0], abs=1e-9)


def test_what_cflib_compresses_is_read_back() -> None:
    memory = pytest.importorskip("cflib.crazyflie.mem.trajectory_memory")
    packed = memory.CompressedStart(1.0, 2.0, 3.0, math.pi / 2).pack()
    packed += memory.CompressedSegment(1.5, [2.0], [], [3.0, 3.5, 4.0], [0.0]).pack()
    packed += memory.CompressedSegment(0.5, [], [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [], []).pack()
    pieces = compressed(bytes(packed).ljust(4096, b"\0"), 0)
    assert pieces is not None
    assert [piece.duration for piece in pieces] == [1.5, 0.5]
    assert pieces[0].at(0.0)[0] == pytest.approx([1, 2, 3, math.pi / 2], abs=2e-3)
    assert pieces[0].at(1.5)[0] == pytest.approx([2, 2, 4, 0], abs=2e-3)
    assert pieces[1].at(0.0)[0] == pytest.approx([2, 2, 4, 0], abs=2e-3)
    assert pieces[1].at(0.5)[0] == pytest.approx([2, 1, 4, 0], abs=2e-3)


def test_a_piece_is_turned_about_the_origin_and_moved() -> None:
    piece = Piece(np.zeros((4, 8)), 1.0)
    piece.coefficients[0, :2] = 1.0, 1.0  # from (1, 0) to (2, 0)
    moved = piece.moved(np.array([0.0, 0.0, 5.0]), math.pi / 2)
    assert moved.at(1.0)[0] == pytest.approx([0, 2, 5, math.pi / 2], abs=1e-12)


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_a_piece_of_no_duration_is_none(duration: float) -> None:
    assert plain(piece_bytes([0.0] * 32, duration), 0, 1) is None


@pytest.mark.parametrize(("offset", "count"), [(1, 1), (0, 2), (0, 0), (1 << 31, 1)])
def test_pieces_outside_the_memory_are_none(offset: int, count: int) -> None:
    assert plain(piece_bytes([0.0] * 32, 1.0), offset, count) is None
    assert compressed(bytes(7), 0) is None


def test_pieces_that_are_no_numbers_are_none() -> None:
    assert plain(piece_bytes([float("nan")] + [0.0] * 31, 1.0), 0, 1) is None
    assert plain(piece_bytes([1e38] * 32, 1e6), 0, 1) is None


def test_a_compressed_trajectory_that_is_cut_off_is_none() -> None:
    start = struct.pack("<hhhh", 0, 0, 0, 0)
    assert compressed(start + struct.pack("<BHh", 1, 1000, 5), 0) is not None
    assert compressed(start + struct.pack("<BH", 1, 1000), 0) is None
    assert compressed(start, 0) is None
