"""Headers, null packets and packed quaternions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from star_fleet.packet import Port, compress, expand, is_null, join, read, sound, split

quaternions = st.tuples(*[st.floats(-1, 1)] * 4)


@given(st.sampled_from(Port), st.integers(0, 3), st.binary(max_size=30))
def test_what_is_joined_can_be_split(port: int, channel: int, payload: bytes) -> None:
    assert split(join(port, channel, payload)) == (port, channel, payload)


def test_bits_that_only_clients_set_do_not_count() -> None:
    assert split(b"\xfd\x01") == (15, 1, b"\x01")
    assert is_null(b"\xf3")
    assert is_null(b"\xff")
    assert not is_null(b"\xfd")


@pytest.mark.parametrize("packet", [b"", bytes(32)])
def test_what_is_empty_or_too_long_is_no_packet(packet: bytes) -> None:
    assert split(packet) is None


def test_a_payload_that_is_too_short_is_not_read() -> None:
    assert read("H", b"\x01") is None
    assert read("H", b"\x01\x02\x03") == (0x0201,)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -2e4])
def test_a_number_that_no_vehicle_can_fly_is_not_sound(value: float) -> None:
    assert sound([0.0, 9999.0])
    assert not sound([0.0, value])


@given(quaternions)
def test_a_quaternion_comes_back_as_the_same_turn(parts: tuple[float, ...]) -> None:
    length = np.linalg.norm(parts)
    assume(length > 0.1)
    quaternion = np.array([parts]) / length
    back = expand(int(compress(quaternion)[0]))
    angle = 2 * np.arccos(min(1.0, abs(float(quaternion[0] @ back))))
    assert angle < 0.005


@given(quaternions)
def test_a_quaternion_is_packed_as_cflib_packs_it(parts: tuple[float, ...]) -> None:
    encoding = pytest.importorskip("cflib.utils.encoding")
    length = np.linalg.norm(parts)
    assume(length > 0.1)
    ours = expand(int(compress(np.array([parts]) / length)[0]))
    theirs = expand(encoding.compress_quaternion(parts))
    assert abs(np.dot(ours, theirs)) == pytest.approx(1.0, abs=1e-5)
    assert ours == pytest.approx(
        encoding.decompress_quaternion(int(compress(np.array([parts]) / length)[0])), abs=1e-9
    )


@given(st.integers(0, 0xFFFFFFFF))
def test_any_bits_give_a_unit_quaternion(packed: int) -> None:
    assert np.linalg.norm(expand(packed)) == pytest.approx(1.0)
