"""Processes beside a flight."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from star_core.toolkit import python_process

SERVE = """
import os
from multiprocessing.connection import Connection

def serve(descriptor):
    connection = Connection(descriptor)
    connection.send((os.getsid(0), os.environ["LIMIT"], connection.recv()))
    connection.recv()
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
