"""Attacks on the guardian: by what a flight sends it, and by other processes."""

from __future__ import annotations

import os
import pickle
import re
import struct
import sys
from multiprocessing import Pipe
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

from star_core import Array, Command, Order, Setpoint, Transform
from star_core.testing import scene
from star_radio.mailbox import Mailbox
from tests.plugins.transports.star_radio import test_guarded
from tests.plugins.transports.star_radio.test_guardian import Flight, flight
from tests.simulators import ideal_fleet

__all__ = ["flight"]

Table = TypeVar("Table")
NAN: Array = np.full((3, 3), np.nan)


def forged(made: Table, **values: Any) -> Table:
    """Return a table with values that its checks would refuse."""
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


def setpoint(velocity: Any, agents: int = 3) -> Setpoint:
    valid = Setpoint(np.zeros((agents, 3)), np.zeros(agents), np.ones(agents, np.bool_))
    return forged(valid, velocity=velocity)


def command(**values: Any) -> Command:
    zero = np.zeros(3)
    return forged(Command(Order.GOTO, np.arange(3), np.zeros((3, 3)), zero, zero + 1), **values)


FRAMES = Transform(np.zeros(3), np.zeros((3, 3)))
HOSTILE: list[Any] = [
    None,
    b"\xff\xfe",
    (),
    (1, "wait"),
    (1, "leave", []),
    (1, "end_flight", 0.0),
    (None, "detach", None),
    (1, "__class__", None),
    (1, "\udcff", None),
    ({}, [], {}),
    (1, "connect", None),
    (1, "upload", []),
    (1, "wait", "soon"),
    (None, "send", (setpoint(NAN), FRAMES)),
    (None, "send", (setpoint(np.zeros((99, 3))), FRAMES)),
    (None, "send", (setpoint(np.zeros((3, 3)), 3), FRAMES, FRAMES)),
    (None, "send", NAN),
    (None, "command", "stop"),
    (None, "command", command(position=NAN)),
    (None, "command", command(agent=np.array([0, 1, 99]))),
    (None, "command", command(duration=np.array([np.nan, -1.0, 1e308]))),
    (None, "command", command(order="stop")),
    (None, "correct", NAN),
    (None, "record_in", 7),
]
OBEYED: list[Any] = [  # a wait is a tick's at most, and frames that are not finite are left out
    (1, "wait", 1e9),
    (1, "wait", float("inf")),
    (None, "send", (setpoint(np.zeros((3, 3))), Transform(np.zeros(3), NAN))),
]


def test_hostile_messages_drop_no_drone(flight: Flight, caplog: pytest.LogCaptureFixture) -> None:
    still = np.zeros((3, 3))
    flight.take_off(0.5, 0.5, 0.5)
    flight.fly(0.5, still)
    for number, message in enumerate(HOSTILE + OBEYED):
        caplog.clear()
        flight._answers.clear()
        flight._posted.append(message)
        flight.guardian.step()
        flight.fly(0.2, still)
        refused = any(answer.problem for answer in flight._answers)
        left_out = "a message is none of the flight's" in caplog.text
        assert (refused or left_out) is (number < len(HOSTILE)), message
    assert flight.guardian._descent is None
    assert not flight.guardian._ended
    assert flight.air.height.min() > 0.3
    flight.silence(0.5)  # hovers by the last setpoint
    assert flight.air.height.min() > 0.3
    flight.die()
    assert not flight.fallen


@pytest.mark.extended
def test_unreadable_messages_drop_no_drone(tmp_path: Path) -> None:
    with ideal_fleet(scene(2), noise=False) as fleet:
        flown = test_guarded.Flight(tmp_path, fleet)
        flown.take_off()
        flown.radio.record_in(tmp_path)
        end = flown.radio._connection.fileno()
        for data in b"", b"\xff\xfe", pickle.dumps([1])[:-1], b"cno.such.module\nx\n.":
            os.write(end, struct.pack("!i", len(data)) + data)
            flown.tick()
        os.write(end, struct.pack("!i", 1000) + b"half")  # and nothing more
        assert flown.has_landed()
        disconnect(flown)
    text = (tmp_path / "guardian.log").read_text()
    assert re.search(r"no message of the flight for 1\.\d+ s: landing cf1, cf2", text)


def disconnect(flown: test_guarded.Flight) -> None:
    """Let the guardian end by itself."""
    flown.radio._connection.close()
    flown.radio._process.wait(test_guarded.PATIENCE)
    flown.radio.close()


def test_an_oversized_message_ends_the_connection() -> None:
    """After which the guardian lands the drones, as after the end of a flight."""
    flight_end, guardian_end = Pipe()
    mailbox = Mailbox(guardian_end)
    os.write(flight_end.fileno(), struct.pack("!iQ", -1, 1 << 62))
    for _ in range(2):
        with pytest.raises(OSError, match="bad message length"):
            mailbox.recv()
    mailbox._socket.close()
    flight_end.close()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_no_other_process_reaches_the_guardian(tmp_path: Path) -> None:
    with ideal_fleet(scene(2), noise=False) as fleet:
        flown = test_guarded.Flight(tmp_path, fleet)
        flown.radio.connect()
        process = Path(f"/proc/{flown.radio._process.pid}")
        inodes = {}
        for link in (process / "fd").iterdir():
            if (opened := re.match(r"socket:\[(\d+)\]", str(link.readlink()))) is not None:
                inodes[opened[1]] = link
        listed = [line.split() for line in Path("/proc/net/unix").read_text().splitlines()]
        unix = [columns for columns in listed if columns[6] in inodes]
        assert len(unix) >= 1
        assert all(len(columns) == 7 for columns in unix)  # without a path to connect to
        tcp = Path("/proc/net/tcp").read_text() + Path("/proc/net/tcp6").read_text()
        assert not any(inode in tcp.split() for inode in inodes)
        for columns in unix:
            with pytest.raises(OSError, match="No such device or address"):
                inodes[columns[6]].open("r+b")
        shared = [line for line in (process / "maps").read_text().splitlines() if " rw-s " in line]
        assert shared == []
        assert not os.get_inheritable(flown.radio._connection.fileno())
        disconnect(flown)
