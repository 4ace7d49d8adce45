"""Transport ``radio``: Crazyflies, on the air through cflib, or simulated by ``star fleet``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from star_core import Offer, Problem, hookimpl
from star_radio import budget
from star_radio.address import RadioAddress, faults
from star_radio.camera import address as camera
from star_radio.options import OPTIONS

if TYPE_CHECKING:
    from star_core import Scene, Transport


LEGACY = "0.1.34"
"""The last cflib that is known to drive Crazyradios in the legacy way only."""


def make(  # noqa: PLR0913 -- one argument for each option
    scene: Scene,
    *,
    absent: str = "refuse",
    patience: float = 2.0,
    deadline: float = 30.0,
    report: float | None = None,
    mode: str = "legacy",
    cache: str | None = None,
    reset: bool = True,
    parameters: Mapping[str, float] | None = None,
    stop: str = "motors",
    watchdog: bool = False,
    cameras: Mapping[str, str] | None = None,
    camera_latency: float = 0.15,
    mocap: Mapping[str, Any] | None = None,
    broadcast: int | None = None,
    udp: str = "sockets",
    setpoints: str = "velocity",
) -> Transport:
    """Return the links to a scene's agents, not open yet.

    Raises:
        PluginError: A system for motion capture or a dongle to broadcast with is not there.
    """
    from pathlib import Path

    from star_radio.datagrams import Datagrams
    from star_radio.manner import Manner
    from star_radio.steering import Velocities, WholeStates
    from star_radio.tables import Tables, user_cache
    from star_radio.transport import Radio, Rules

    decks = capture = shouts = None
    if mocap:
        from star_radio.mocap import MotionCapture

        names = mocap.get("names", {})
        capture = MotionCapture(scene, kind=mocap["type"], hostname=mocap["hostname"], names=names)
    if broadcast is not None:
        from star_radio.shouts import Shouts

        shouts = Shouts(scene, broadcast)
    if cameras:
        from star_radio.decks import Decks

        decks = Decks(scene, cameras, camera_latency)
    uris = [agent.uri or "" for agent in scene.agents]
    return Radio(
        scene,
        Manner(
            Tables(Path(cache) if cache else user_cache()),
            period=report or budget.report_period(uris, mode),
            patience=patience,
            deadline=deadline,
            reset=reset,
            parameters=parameters or {},
        ),
        Rules(without=absent == "fly-without", latch=stop == "lock", watchdog=watchdog),
        WholeStates(len(uris)) if setpoints == "full-state" else Velocities(),
        decks=decks,
        mocap=capture,
        shouts=shouts,
        datagrams=Datagrams() if udp == "sockets" else None,
    )


def check(
    scene: Scene,
    *,
    report: float | None = None,
    mode: str = "legacy",
    cameras: Mapping[str, str] | None = None,
    mocap: Mapping[str, Any] | None = None,
    watchdog: bool = False,
    broadcast: int | None = None,
    **_others: Any,
) -> Iterable[Problem]:
    """Say which agents cannot be reached or served, and what is not installed."""
    from importlib.util import find_spec

    for package, needed, path, install in (
        ("cflib", True, (), "'star-swarm[radio]'"),
        ("motioncapture", mocap is not None, ("mocap",), "motioncapture"),
    ):
        if needed and find_spec(package) is None:
            yield Problem(path, f"it needs the package {package!r}: pip install {install}")
    if watchdog and scene.period > 0.5:  # noqa: PLR2004 -- s; its time is 1 s
        yield Problem(("watchdog",), f"it needs a tick of 0.5 s or less, got {scene.period:g} s")
    yield from (Problem((), wrong) for wrong in faults(scene.agents))
    uris = [agent.uri for agent in scene.agents if agent.uri]
    if mode == "inline" and budget.shared(uris) and (old := _old_cflib()):
        yield Problem(("mode",), f"cflib {old} drives no dongle so; leave it out")
    yield from (Problem((), over) for over in budget.overloads(uris, mode, scene.period, report))
    links = [agent for agent in scene.agents if _dongle(agent.uri) == str(broadcast)]
    if links:
        said = f"dongle {broadcast} has the link of agent {links[0].name!r}: expected another"
        yield Problem(("broadcast",), said)
    for name, wrong in camera.faults(scene, cameras or {}):
        yield Problem(("cameras", name), wrong)


def _old_cflib() -> str:
    """Return the version of cflib if it is one that drives dongles in the legacy way only."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        has = version("cflib")
    except PackageNotFoundError:
        return ""
    from packaging.version import Version  # cflib needs it, so it is there

    return has if Version(has) <= Version(LEGACY) else ""


def _dongle(uri: str | None) -> str | None:
    """Return the number or the serial of the dongle of a link; None if it has none."""
    radio = RadioAddress.of(uri or "")
    return None if radio is None else radio.dongle


@hookimpl
def star_transports() -> Iterable[Offer[Transport]]:
    yield Offer(
        name="radio",
        summary="Crazyflies by their links' addresses: radio, UDP, TCP or USB.",
        make=make,
        options=OPTIONS,
        check=check,
        realtime=True,
    )
