"""Ground truth from motion capture, by a stand-in for the package ``motioncapture``."""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import star_radio
from star_core import PluginError, Truth
from star_radio.mocap import TrueBodies
from tests.plugins.transports.star_radio.conftest import options, reached
from tests.waiting import eventually

URIS = ["udp://127.0.0.1:9", "udp://127.0.0.1:7"]
PACKAGE = """
import time
from types import SimpleNamespace

def connect(kind, options):
    if kind == "broken":
        raise RuntimeError("no route to host")
    if kind == "deaf":
        time.sleep(60)
    return System(kind, options["hostname"])

class System:
    def __init__(self, kind, hostname):
        self.name = f"{kind} at {hostname}"
        self.kind = kind
        self.begun = time.monotonic()

    def waitForNextFrame(self):
        if self.kind == "silent" and time.monotonic() > self.begun + 0.1:
            time.sleep(60)
        if self.kind == "ending" and time.monotonic() > self.begun + 0.1:
            raise RuntimeError("gone")
        time.sleep(0.01)
        self.x = time.monotonic() - self.begun  # last, as near as possible to the frame's time

    @property
    def rigidBodies(self):
        turn = SimpleNamespace(x=0.0, y=0.0, z=0.6, w=0.8)
        return {
            "cf1": SimpleNamespace(position=[self.x, 2.0, 3.0], rotation=turn),
            self.name: SimpleNamespace(position=[0.0, 0.0, 1.0], rotation=turn),
        }
"""
RUN = """
import time
from star_radio.mocap import TrueBodies
from tests.plugins.transports.star_radio.conftest import options, reached

source = {"motioncapture": {"type": "mock", "host": "x"}}
capture = TrueBodies(reached(["udp://127.0.0.1:9"]), {"source": source})
time.sleep(0.2)
assert capture.truth(0.0) is not None
"""


@pytest.fixture
def package(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Bodies: cf1, which moves at 1 m/s along x, and one that is named as what was asked for."""
    (tmp_path / "motioncapture.py").write_text(PACKAGE)
    monkeypatch.syspath_prepend(tmp_path)


def bodies(kind: str, **system: Any) -> TrueBodies:
    source = {"motioncapture": {"type": kind, "host": "host"}}
    return TrueBodies(reached(URIS), {"source": source, **system})


def moving_truth(capture: TrueBodies, began: float = 0.0) -> Truth:
    """Return the truth once it has a velocity: from two frames, of which the newest is not old."""

    def moving() -> Truth | None:
        truth = capture.truth(began)
        return truth if truth is not None and np.isfinite(truth.velocity[0]).all() else None

    truth = eventually(moving)
    assert truth is not None
    return truth


def is_unknown(capture: TrueBodies) -> bool:
    truth = capture.truth(0.0)
    return truth is not None and bool(np.isnan([truth.position, truth.velocity]).all())


@pytest.mark.usefixtures("package")
def test_bodies_are_the_truth() -> None:
    names = {"cf2": "optitrack at host"}
    began = time.monotonic()
    capture = bodies("optitrack", bodies=names)
    with closing(capture):
        assert eventually(lambda: len(capture._system.recent()) > 20)
        truth = moving_truth(capture, began)
    assert truth.time > 0.1
    assert np.allclose(truth.position[:, 1:], [[2, 3], [0, 1]])
    assert np.allclose(truth.velocity, [[1, 0, 0], [0, 0, 0]], atol=0.3)
    assert np.allclose(truth.attitude, [[0, 0, 0.6, 0.8]] * 2)


@pytest.mark.usefixtures("package")
def test_an_old_frame_is_not_the_truth(caplog: pytest.LogCaptureFixture) -> None:
    with closing(bodies("silent")) as capture:
        for _time in range(2):
            assert eventually(lambda: is_unknown(capture))
    assert caplog.messages == ["radio: mocap sends no frames: no ground truth until it does"]


@pytest.mark.usefixtures("package")
def test_a_body_that_is_not_seen_is_not_a_number() -> None:
    with closing(bodies("optitrack")) as capture:
        truth = moving_truth(capture)
    assert np.isnan(truth.position).tolist() == [[False] * 3, [True] * 3]


@pytest.mark.usefixtures("package")
def test_a_system_that_ends_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    with closing(bodies("ending")):
        assert eventually(lambda: "source 'motioncapture' ended: gone" in caplog.text)


@pytest.mark.usefixtures("package")
def test_closing_ends_the_process_of_a_silent_system(caplog: pytest.LogCaptureFixture) -> None:
    capture = bodies("silent")
    for _time in range(2):
        capture.close()
        assert capture._system._process.poll() is not None
        assert not capture._system._thread.is_alive()
    assert not caplog.messages


@pytest.mark.usefixtures("package")
def test_the_transport_reports_it() -> None:
    system = {"source": {"motioncapture": {"type": "vicon", "host": "host"}}}
    radio = star_radio.make(reached(URIS), **options(mocap=system))
    with closing(radio):
        assert radio.truth() is None
        radio.wait(0.0)
        assert eventually(radio.truth)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "motioncapture", None)
    with pytest.raises(PluginError, match="it needs the package 'motioncapture': pip install"):
        bodies("vicon")


@pytest.mark.usefixtures("package")
@pytest.mark.parametrize(
    ("kind", "timeout", "problem"),
    [("broken", 10.0, "no route to host"), ("deaf", 0.2, "no frame in 0.2 s")],
)
def test_a_system_that_cannot_be_reached_is_named(kind: str, timeout: float, problem: str) -> None:
    with pytest.raises(PluginError, match=f"motion capture: source 'motioncapture': {problem}"):
        bodies(kind, connect_timeout=timeout)


@pytest.mark.campaign
@pytest.mark.parametrize("closes", [True, False])
@pytest.mark.skipif(find_spec("motioncapture") is None, reason="motioncapture is not installed")
def test_the_real_package_does_not_abort_the_process(*, closes: bool) -> None:
    program = RUN + ("capture.close()\n" if closes else "")
    for _run in range(20):
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, timeout=30, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")
