"""Processes beside a flight."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from star_core.toolkit import messages_from, python_process

SERVE = """
import os
from multiprocessing.connection import Connection

def serve(descriptor):
    connection = Connection(descriptor)
    connection.send((os.getsid(0), os.environ["LIMIT"], connection.recv()))
    connection.recv()
"""
TORN = """
import os, struct
from multiprocessing.connection import Connection

def serve(descriptor):
    connection = Connection(descriptor)
    connection.send(1)
    connection.send(2)
    os.write(descriptor, struct.pack("!i", 100) + b"of a hundred bytes")
    os._exit(1)
"""


def test_a_process_answers_and_ends_with_its_connection(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "echo_process.py").write_text(SERVE)
    monkeypatch.syspath_prepend(tmp_path)
    process, connection = python_process("echo_process", LIMIT="1")
    with process:
        connection.send("a scene")
        session, limit, scene = connection.recv()
        assert (limit, scene) == ("1", "a scene")
        assert session == process.pid != os.getsid(0)  # no signals of the terminal
        connection.close()
        process.wait(10)


def test_messages_end_with_the_process_that_sends_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "torn_process.py").write_text(TORN)
    monkeypatch.syspath_prepend(tmp_path)
    process, connection = python_process("torn_process")
    with process, connection:
        assert [*messages_from(connection)] == [1, 2]
