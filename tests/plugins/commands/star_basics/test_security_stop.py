"""Attacks on the sockets by which `star stop` reaches flights."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from star_basics import land_requests
from star_basics.land_requests import MAX_MESSAGE, listening
from star_core import Operator
from star_core.commands.main import main
from tests.commands import Printed
from tests.plugins.commands.star_basics.test_land_requests import runtime

__all__ = ["runtime"]
HOSTILE = (b"", b"\xff\xfe", b"LAND", b"land\n", b"landx", b"x" * 10 * MAX_MESSAGE, None)


def test_hostile_requests_land_no_flight(
    runtime: Path, monkeypatch: pytest.MonkeyPatch, capsys: Printed
) -> None:
    monkeypatch.setattr(land_requests, "ANSWER_TIMEOUT", 0.05)
    operator = Operator()
    with listening(operator, "demo"):
        (path,) = runtime.iterdir()
        for request in (
            b"",
            b"\xff\xfe",
            b"LAND",
            b"land\n",
            b"landx",
            b"x" * 10 * MAX_MESSAGE,
            None,
        ):
            with socket.socket(socket.AF_UNIX) as client:
                client.connect(str(path))
                if request is not None:  # else nothing is sent
                    client.sendall(request)
        assert main(["stop", "--list"]) == 0
        assert operator.stops == 0
        assert main(["stop"]) == 0
        assert operator.stops == 1
    assert f"demo (process {os.getpid()})" in capsys.readouterr().out


def test_links_are_no_sockets_of_flights(runtime: Path, capsys: Printed) -> None:
    operator = Operator()
    with listening(operator, "demo"):
        (path,) = runtime.iterdir()
        (runtime / "7.sock").symlink_to(path)
        assert main(["stop", "7"]) == 1
        assert "process 7 has no socket" in capsys.readouterr().err
        assert operator.stops == 0
        (runtime / "7.sock").unlink()
    (runtime / "7.sock").mkdir()
    assert main(["stop"]) == 1
    assert (runtime / "7.sock").is_dir()


@pytest.mark.parametrize("kind", ["a link", "a file", "of another user", "open to others"])
def test_folders_of_others_are_neither_used_nor_asked(
    runtime: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    kind: str,
) -> None:
    planted = tmp_path / "planted"
    planted.mkdir(mode=0o700)
    match kind:
        case "a link":
            runtime.symlink_to(planted)
        case "a file":
            runtime.touch()
        case "of another user":
            runtime.mkdir(mode=0o700)
            monkeypatch.setattr(os, "getuid", lambda: os.geteuid() + 1)
        case _:
            runtime.mkdir()
            runtime.chmod(0o770)
    operator = Operator()
    with listening(operator, "demo"):
        assert "`star stop` cannot land this flight" in caplog.text
        assert list(planted.iterdir()) == []
        assert main(["stop"]) in {1, 2}
        assert operator.stops == 0
