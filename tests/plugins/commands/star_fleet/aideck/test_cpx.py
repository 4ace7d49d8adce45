"""CPX frames come out of a stream as they went in, whatever else is in it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_fleet.cpx import ROOM, Decoder, Function, Packet, SyncError, Target, encode

packets = st.builds(
    Packet,
    st.sampled_from(Target),
    st.sampled_from(Target),
    st.sampled_from(Function),
    st.binary(max_size=ROOM),
    st.booleans(),
)


def in_pieces(stream: bytes, sizes: list[int]) -> list[bytes]:
    pieces = []
    for size in sizes:
        pieces.append(stream[:size])
        stream = stream[size:]
    return [*pieces, stream]


@given(st.lists(packets, max_size=5), st.lists(st.integers(0, 700), max_size=9))
def test_packets_survive_any_fragmentation_of_the_stream(
    sent: list[Packet], sizes: list[int]
) -> None:
    decoder = Decoder()
    stream = b"".join(map(encode, sent))
    assert [p for piece in in_pieces(stream, sizes) for p in decoder.feed(piece)] == sent


@given(packets)
def test_frames_are_those_of_cflib(packet: Packet) -> None:
    cpx = pytest.importorskip("cflib.cpx")
    theirs = cpx.CPXPacket()
    theirs.wireData = encode(packet)[2:]
    assert theirs.source.value == packet.source
    assert theirs.destination.value == packet.destination
    assert theirs.function.value == packet.function
    assert (theirs.data, theirs.lastPacket) == (packet.data, packet.last)
    assert bytes(theirs.wireData) == encode(packet)[2:]


@given(st.lists(st.binary(max_size=200), max_size=5))
def test_arbitrary_streams_give_packets_or_a_sync_error(pieces: list[bytes]) -> None:
    decoder = Decoder()
    for piece in pieces:
        try:
            packets = decoder.feed(piece)
        except SyncError:
            continue
        assert all(len(packet.data) <= ROOM for packet in packets)


@pytest.mark.parametrize(
    "frame",
    [bytes.fromhex("0200 5945"), bytes.fromhex("0200 5909"), bytes.fromhex("0200 3f05")],
    ids=["another version", "no such function", "no such target"],
)
def test_a_frame_that_means_nothing_is_passed_over(frame: bytes) -> None:
    decoder = Decoder()
    after = Packet(Target.HOST, Target.STM32, Function.CRTP, b"\xf3")
    assert decoder.feed(frame + encode(after)) == [after]


@pytest.mark.parametrize("length", [0, 1, 1023, 65_535])
def test_a_length_that_no_frame_has_is_refused(length: int) -> None:
    with pytest.raises(SyncError, match=rf"^frame of {length} bytes, expected 2 to 1022$"):
        Decoder().feed(length.to_bytes(2, "little"))


def test_a_decoder_begins_anew_after_it_lost_its_way() -> None:
    decoder = Decoder()
    after = Packet(Target.HOST, Target.STM32, Function.CRTP, b"\xf3")
    with pytest.raises(SyncError):
        decoder.feed(b"\0\0\0")
    assert decoder.feed(encode(after)) == [after]
