"""Ground truth from a motion-capture system that a test makes up."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Mapping
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import star_radio
from star_core import PluginError
from star_radio.mocap import MotionCapture
from tests.plugins.transports.star_radio.conftest import reached

URIS = ["udp://127.0.0.1:9", "udp://127.0.0.1:7"]


class System:
    """A system with two bodies, of which one moves at 1 m/s along x."""

    def __init__(self) -> None:
        self.asked: tuple[str, Mapping[str, str]] | None = None
        self.begun = time.monotonic()
        self.ended = threading.Event()

    def connect(self, kind: str, options: Mapping[str, str]) -> System:
        if kind == "broken":
            raise RuntimeError("no route to host")
        self.asked = kind, options
        return self

    def waitForNextFrame(self) -> None:  # noqa: N802 -- the package's own name
        if self.ended.wait(0.01):
            raise RuntimeError("gone")

    @property
    def rigidBodies(self) -> Mapping[str, object]:  # noqa: N802
        turn = SimpleNamespace(x=0.0, y=0.0, z=0.6, w=0.8)
        x = time.monotonic() - self.begun
        return {
            "cf1": SimpleNamespace(position=np.array([x, 2.0, 3.0]), rotation=turn),
            "Rigid 7": SimpleNamespace(position=np.array([0.0, 0.0, 1.0]), rotation=turn),
        }


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> System:
    system = System()
    module = ModuleType("motioncapture")
    vars(module)["connect"] = system.connect
    monkeypatch.setitem(sys.modules, "motioncapture", module)
    return system


def test_bodies_are_the_truth(system: System) -> None:
    capture = MotionCapture(
        reached(URIS), kind="optitrack", hostname="host", names={"cf2": "Rigid 7"}
    )
    began = time.monotonic()
    time.sleep(0.3)
    truth = capture.truth(began)
    capture.close()
    assert system.asked == ("optitrack", {"hostname": "host"})
    assert truth is not None
    assert 0 < truth.time < 0.6
    assert np.allclose(truth.position[:, 1:], [[2, 3], [0, 1]])
    assert np.allclose(truth.velocity, [[1, 0, 0], [0, 0, 0]], atol=0.3)
    assert np.allclose(truth.attitude, [[0, 0, 0.6, 0.8]] * 2)


def test_what_is_old_is_not_the_truth_any_more(
    system: System, caplog: pytest.LogCaptureFixture
) -> None:
    capture = MotionCapture(reached(URIS), kind="optitrack", hostname="host")
    time.sleep(0.05)
    system.ended.set()
    time.sleep(0.2)
    for _ask in range(2):
        truth = capture.truth(0.0)
        assert truth is not None
        assert np.isnan(truth.position).all()
        assert np.isnan(truth.velocity).all()
    capture.close()
    said = "radio: mocap says nothing: truth is unknown until it does"
    assert caplog.messages == ["radio: mocap ended: gone", said]


@pytest.mark.usefixtures("system")
def test_a_body_that_is_not_seen_is_not_a_number() -> None:
    capture = MotionCapture(reached(URIS), kind="optitrack", hostname="host")
    time.sleep(0.1)
    truth = capture.truth(0.0)
    capture.close()
    assert truth is not None
    assert np.isnan(truth.position).tolist() == [[False] * 3, [True] * 3]


def test_there_is_no_truth_before_the_first_frame(system: System) -> None:
    system.ended.set()
    assert MotionCapture(reached(URIS), kind="vicon", hostname="host").truth(0.0) is None


def test_a_system_that_ends_is_told(system: System, caplog: pytest.LogCaptureFixture) -> None:
    MotionCapture(reached(URIS), kind="vicon", hostname="host")
    system.ended.set()
    end = time.monotonic() + 3
    while "mocap ended: gone" not in caplog.text and time.monotonic() < end:
        time.sleep(0.01)
    assert "radio: mocap ended: gone" in caplog.text


@pytest.mark.usefixtures("system")
def test_the_transport_tells_it() -> None:
    radio = star_radio.make(reached(URIS), mocap={"type": "vicon", "hostname": "host"})
    assert radio.truth() is None
    radio.wait(0.0)
    radio.wait(0.2)
    assert radio.truth() is not None
    radio.close()


def test_a_package_that_lacks_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "motioncapture", None)
    with pytest.raises(PluginError, match="mocap needs the package 'motioncapture': pip install"):
        MotionCapture(reached(URIS), kind="vicon", hostname="host")


@pytest.mark.usefixtures("system")
def test_a_system_that_cannot_be_reached_is_named() -> None:
    with pytest.raises(PluginError, match="mocap: no 'broken' at 'host': no route to host"):
        MotionCapture(reached(URIS), kind="broken", hostname="host")
