"""Opening the links: what is set up, what is refused, and which agents are named."""

from __future__ import annotations

import json
import math
import struct
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from star_core import PluginError
from star_radio.transport import Radio
from tests.plugins.transports.star_radio.conftest import UNSERVED, Open, Peers, ticks
from tests.plugins.transports.star_radio.peer import PARAMETERS, VALUES, Peer
from tests.waiting import PATIENCE


def test_a_drone_reports_as_soon_as_it_is_connected(drone: Peer, connect: Open) -> None:
    drone.values["stateEstimateZ.x"] = 1500
    radio = connect([drone])
    telemetry = radio.receive()
    assert telemetry.position.tolist() == [[1.5, 0.0, 0.0]]
    assert telemetry.age[0] < 0.5


def test_the_estimator_starts_anew(drone: Peer, connect: Open) -> None:
    connect([drone])
    assert drone.sent_to(2, 2)[:2] == [b"\0\0\1", b"\0\0\0"]


VARIANCES = {f"kalman.var{axis}": 1e-4 for axis in ("PX", "PY", "PZ")}


def test_an_estimator_is_waited_for_until_it_has_settled(drone: Peer, connect: Open) -> None:
    drone.values |= VARIANCES
    report, begun = drone.report, time.monotonic()

    def settle(now: float, block: int = 1) -> None:
        if now < begun + 1.0:
            drone.values["kalman.varPZ"] += 0.001
        report(now, block)

    drone.report = settle  # type: ignore[method-assign]
    connect([drone])
    assert time.monotonic() - begun > 1.2
    assert drone.sent_to(5, 1)[-1] == b"\2\2"  # its block is deleted


def test_estimators_settle_at_the_same_time(udp_peers: Peers, connect: Open) -> None:
    drones = udp_peers(6)
    for drone in drones:
        drone.values |= VARIANCES
    begun = time.monotonic()
    connect(drones, response_timeout=PATIENCE)
    assert time.monotonic() - begun < 2.5  # one after the other, they would take more than 3 s


@pytest.mark.parametrize("growth", [0.0003, math.nan])
def test_an_estimator_that_does_not_settle_is_named(
    peers: Peers, connect: Open, monkeypatch: pytest.MonkeyPatch, growth: float
) -> None:
    monkeypatch.setattr("star_radio.connection.estimator.CONVERGENCE_TIMEOUT", 0.9)
    [drone] = peers()
    drone.values |= VARIANCES
    report = drone.report

    def diverge(now: float, block: int = 1) -> None:
        drone.values["kalman.varPX"] += growth * (block == 2)
        report(now, block)

    drone.report = diverge  # type: ignore[method-assign]
    with pytest.raises(
        PluginError, match=r"cf1 \(its estimator has not converged in 0.9 s: check that the"
    ):
        connect([drone])


def test_an_estimator_that_is_left_alone_is_not_waited_for(peers: Peers, connect: Open) -> None:
    [drone] = peers(lacks=("kalman.resetEstimation",))
    drone.values |= dict.fromkeys(VARIANCES, math.nan)
    connect([drone], reset=False)
    assert drone.sent_to(2, 2) == []
    assert all(payload[1:2] != b"\2" for payload in drone.sent_to(5, 1))


def test_the_second_of_two_drones_reads_no_table(peers: Peers, connect: Open) -> None:
    drones = peers(3)
    connect(drones)
    asked = [sum(payload[0] == 2 for payload in drone.sent_to(5, 0)) for drone in drones]
    assert sorted(asked) == [0, 0, len(VALUES)]


def test_the_next_flight_reads_no_table(peers: Peers, connect: Open) -> None:
    drones = peers()
    connect(drones).close()
    [again] = peers()
    connect([again])
    assert again.sent_to(5, 0) == again.sent_to(2, 0) == [b"\3"]


def test_a_cache_that_is_spoilt_is_read_anew(peers: Peers, connect: Open, tmp_path: Path) -> None:
    connect(peers()).close()
    for path in tmp_path.glob("*.json"):
        path.write_text('{"a": [1')
    [again] = peers()
    connect([again])
    assert len(again.sent_to(5, 0)) == 1 + len(VALUES)
    assert all(json.loads(path.read_text()) for path in tmp_path.glob("*.json"))


@pytest.mark.parametrize("lacks", [(), ("radio.rssi",)])  # 26 bytes, of at most 26, and 25
@pytest.mark.parametrize(
    "lost", [b"\xd1", b"\x50\3", b"\x50\2\5\0", b"\x22", b"\x51\5", b"\x51\6", b"\x51\7", b"\x51\3"]
)
def test_a_lost_answer_is_asked_for_again(
    peers: Peers, connect: Open, lost: bytes, lacks: tuple[str, ...]
) -> None:
    [drone] = peers(lacks=lacks)
    drone.values["stateEstimateZ.x"] = 1500
    drone.lose[lost] = 2
    telemetry = connect([drone]).receive()
    assert telemetry.position[0, 0] == 1.5
    assert telemetry.age[0] < 0.5


def test_an_old_answer_is_not_taken_for_a_new_one(
    peers: Peers, connect: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("star_radio.connection.questions.MIN_RETRY_PERIOD", 0.05)
    [drone] = peers()
    drone.delay = 0.2
    radio = connect([drone], response_timeout=2.0)
    assert drone.stored["kalman.resetEstimation"] == b"\0"
    assert radio.receive().age[0] < 0.5


def test_reports_that_end_again_are_begun_anew(drone: Peer, connect: Open) -> None:
    drone.values |= VARIANCES
    answer, begun = drone._log, 0

    def log(payload: bytes) -> bytes:
        nonlocal begun
        if payload[:2] == b"\3\2":  # the reports of its estimator: a late reset ends all before
            begun += 1
            if begun == 1:
                answer(b"\5")
        return answer(payload)

    drone._log = log  # type: ignore[method-assign]
    assert connect([drone]).receive().age[0] < 0.5
    assert begun > 1


def test_every_absent_drone_is_named(drone: Peer, make: Open) -> None:
    radio = make([UNSERVED, drone.uri, "udp://127.0.0.1:7"])
    with pytest.raises(PluginError) as caught:
        radio.connect()
    told = str(caught.value)
    assert told.startswith(
        "cannot reach 2 of 3 agents: cf1 (no answer about its protocol version from "
        "udp://127.0.0.1:9 in 0.6 s"
    )
    assert "cf3 (no answer about its protocol version from udp://127.0.0.1:7" in told
    assert "; to fly without them, set 'absent: fly-without' in a mission with 'safety:" in told
    assert "cf2" not in told


def test_the_others_fly_without_an_absent_drone(
    drone: Peer, make: Open, caplog: pytest.LogCaptureFixture
) -> None:
    radio = make([UNSERVED, drone.uri], absent="fly-without")
    begun = time.monotonic()
    radio.connect()
    assert time.monotonic() - begun < 5
    telemetry = radio.receive()
    assert telemetry.age[0] > 0.5 > telemetry.age[1]
    assert "cannot reach 1 of 2 agents: cf1" in caplog.text


@pytest.mark.usefixtures("virtual_clock")
@pytest.mark.parametrize("absent", ["refuse", "fly-without"])
def test_no_agent_flies_when_all_are_absent(make: Open, absent: str) -> None:
    with pytest.raises(PluginError, match="cannot reach 1 of 1 agents: cf1") as caught:
        make([UNSERVED], absent=absent).connect()
    assert "fly-without" not in str(caught.value)


@pytest.mark.parametrize(
    ("uri", "problem"),
    [
        ("tin://can", r".cflib has no driver for 'tin://can'"),
        ("radio://0/80/2M", r"\(radio://0/80/2M: .*[Cc]razyradio"),
    ],
)
def test_a_link_without_a_driver_or_dongle_is_named(make: Open, uri: str, problem: str) -> None:
    with pytest.raises(PluginError, match=f"cf1 {problem}"):
        make([uri], response_timeout=PATIENCE).connect()


def confuse(drone: Peer, method: str, answer: bytes) -> None:
    """Let a drone answer the requests that a method answers by their beginnings and some bytes."""
    setattr(drone, method, lambda payload, *_more: payload[:2] + answer)


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda drone: setattr(drone, "version", 3), "version 3, expected 4 or later"),
        (lambda drone: confuse(drone, "_table", b""), "sent an invalid answer: unpack_from"),
        (lambda drone: drone.values.pop("pm.vbatMV"), "no log variable 'pm.vbatMV' or 'pm.vbat'"),
        (lambda drone: setattr(drone, "refuses_block", 12), "log block .*: it has no memory left"),
        (lambda drone: confuse(drone, "_log", b"\0\0"), "does not report its state"),
        (
            lambda drone: drone.lose.update({b"\x22\3\0": 1000}),
            "no answer about parameter 'ring.effect' from udp://",
        ),
        (
            lambda drone: confuse(drone, "_write", b"\1"),
            "no answer about parameter 'ring.effect' .* in 0.6 s, but '030001'",
        ),
    ],
)
def test_a_drone_that_cannot_be_flown_is_named(
    drone: Peer, connect: Open, spoil: Callable[[Peer], object], problem: str
) -> None:
    spoil(drone)
    with pytest.raises(PluginError, match=rf"cf1 \(.*{problem}"):
        connect([drone], parameters={"ring.effect": 7})


MOTORS = "parameter 'motorPowerSet.enable' would run motors past the safety filter"


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("pid.nothing", 1, "its firmware has no parameter 'pid.nothing'"),
        ("system.selftestPassed", 1, "parameter 'system.selftestPassed' is read-only"),
        ("ring.effect", 1.5, "parameter 'ring.effect' is a whole number, got 1.5"),
        ("ring.effect", 300, "parameter 'ring.effect' cannot be 300: "),
        ("motorPowerSet.enable", 1, MOTORS),
    ],
)
def test_a_parameter_that_cannot_be_set_is_named(
    drone: Peer, connect: Open, name: str, value: float, message: str
) -> None:
    with pytest.raises(PluginError, match=f"cf1 .{message}"):
        connect([drone], parameters={name: value})
    assert drone.stored.get(name, b"") == PARAMETERS.get(name, (0, b""))[1]


def test_parameters_are_set_in_their_own_types(drone: Peer, connect: Open) -> None:
    connect([drone], parameters={"velCtlPid.vxKp": 22.5, "ring.effect": 7})
    assert drone.stored["velCtlPid.vxKp"] == struct.pack("<f", 22.5)
    assert drone.stored["ring.effect"] == b"\7"


def test_parameters_of_one_agent_go_before_those_of_all(peers: Peers, connect: Open) -> None:
    first, second = peers(2)
    own = {"cf2": {"ring.effect": 9}}
    connect([first, second], parameters={"ring.effect": 7}, agent_parameters=own)
    assert [drone.stored["ring.effect"] for drone in (first, second)] == [b"\7", b"\11"]


def test_parameters_are_set_in_flight_until_confirmed(
    peers: Peers, connect: Open, caplog: pytest.LogCaptureFixture
) -> None:
    first, second, third = peers(3)
    radio = connect([first, second, third])
    second.lose[b"\x22\3\0"] = 2  # answers about this parameter
    radio.set_parameters([0, 1], {"ring.effect": 7})
    radio.set_parameters([0, 1], {"ring.effect": float("nan")})
    radio.set_parameters([0, 1], {"pid.nothing": 1})
    radio.set_parameters([0, 1], {"motorPowerSet.enable": 1, "pm.nothing": 2})
    ticks(radio, 40)
    assert first.stored["motorPowerSet.enable"] == b"\0"
    effects = [drone.stored["ring.effect"] for drone in (first, second, third)]
    assert effects == [b"\7", b"\7", PARAMETERS["ring.effect"][1]]
    assert second.lose[b"\x22\3\0"] == 0
    assert [record.getMessage() for record in caplog.records] == [
        "radio: cf1, cf2: parameter 'ring.effect' is a whole number, got nan",
        "radio: cf1, cf2: its firmware has no parameter 'pid.nothing'",
        f"radio: cf1, cf2: {MOTORS}",
        "radio: cf1, cf2: its firmware has no parameter 'pm.nothing'",
    ]


def test_closing_neither_locks_a_drone_nor_leaves_it_reporting(drone: Peer, radio: Radio) -> None:
    before = len(drone.got)
    radio.close()
    radio.close()
    assert drone.got[before] == b"\x71" + bytes(5)  # the high-level commander may be used again
    assert set(drone.got[before + 1 :]) == {b"\x51\5"}  # and no report comes any more


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # cflib's own socket
def test_cflib_writes_nothing(
    udp_peers: Peers, make: Open, capfd: pytest.CaptureFixture[str]
) -> None:
    radio = make([udp_peers()[0].uri, "tcp://127.0.0.1:9"], absent="fly-without")
    radio.connect()
    radio.close()
    out, err = capfd.readouterr()
    assert (out, err) == ("", "radio: connected: 0 of 2 agents\n")
