"""Transport ``radio``: Crazyflies reached through cflib, or simulated by ``star fleet``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from star_core import Problem, TransportSpec, hookimpl
from star_radio import budget
from star_radio.address import RadioAddress, faults
from star_radio.camera import address as camera
from star_radio.options import OPTIONS

if TYPE_CHECKING:
    from star_core import Scene, Transport


LEGACY = "0.1.34"
"""The last cflib version known to support only the legacy Crazyradio mode."""


def make(  # noqa: PLR0913 -- one argument for each option
    scene: Scene,
    *,
    absent: str = "refuse",
    response_timeout: float = 2.0,
    connect_timeout: float = 30.0,
    report_period: float | None = None,
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
    """Return the transport for a scene's agents; its links are not open yet.

    Raises:
        PluginError: The motion-capture system or the dongle for broadcasts is not available.
    """
    from pathlib import Path

    from star_radio.connection_options import ConnectionOptions
    from star_radio.steering import Velocities, WholeStates
    from star_radio.tables import Tables, user_cache
    from star_radio.transport import Radio, Rules
    from star_radio.udp_links import UdpLinks

    ai_decks = capture = broadcasts = None
    if mocap:
        from star_radio.mocap import MotionCapture

        names = mocap.get("names", {})
        capture = MotionCapture(scene, kind=mocap["type"], hostname=mocap["hostname"], names=names)
    if broadcast is not None:
        from star_radio.broadcast_commands import BroadcastCommands

        broadcasts = BroadcastCommands(scene, broadcast)
    if cameras:
        from star_radio.ai_decks import AiDecks

        ai_decks = AiDecks(scene, cameras, camera_latency)
    uris = [agent.uri or "" for agent in scene.agents]
    return Radio(
        scene,
        ConnectionOptions(
            Tables(Path(cache) if cache else user_cache()),
            report_period=report_period or budget.report_period(uris, mode),
            response_timeout=response_timeout,
            connect_timeout=connect_timeout,
            reset=reset,
            parameters=parameters or {},
        ),
        Rules(fly_without_absent=absent == "fly-without", latch=stop == "lock", watchdog=watchdog),
        WholeStates(len(uris)) if setpoints == "full-state" else Velocities(),
        ai_decks=ai_decks,
        mocap=capture,
        broadcasts=broadcasts,
        udp_links=UdpLinks() if udp == "sockets" else None,
    )


def check(
    scene: Scene,
    *,
    report_period: float | None = None,
    mode: str = "legacy",
    cameras: Mapping[str, str] | None = None,
    mocap: Mapping[str, Any] | None = None,
    watchdog: bool = False,
    broadcast: int | None = None,
    **_others: Any,
) -> Iterable[Problem]:
    """Yield agents with unusable addresses, overloaded dongles and missing packages."""
    from importlib.util import find_spec

    for package, needed, path, install in (
        ("cflib", True, (), "'star-swarm[radio]'"),
        ("motioncapture", mocap is not None, ("mocap",), "motioncapture"),
    ):
        if needed and find_spec(package) is None:
            yield Problem(path, f"it needs the package {package!r}: pip install {install}")
    if watchdog and scene.period > 0.5:  # noqa: PLR2004 -- s; its time is 1 s
        yield Problem(("watchdog",), f"it needs a tick of 0.5 s or less, got {scene.period:g} s")
    yield from (Problem((), text) for text in faults(scene.agents))
    uris = [agent.uri for agent in scene.agents if agent.uri]
    if mode == "inline" and budget.shared(uris) and (old := _old_cflib()):
        yield Problem(("mode",), f"cflib {old} does not support this mode; remove the option")
    yield from (
        Problem((), over) for over in budget.overloads(uris, mode, scene.period, report_period)
    )
    links = [agent for agent in scene.agents if _dongle(agent.uri) == str(broadcast)]
    if links:
        text = f"dongle {broadcast} carries the link of agent {links[0].name!r}: expected another"
        yield Problem(("broadcast",), text)
    for name, text in camera.faults(scene, cameras or {}):
        yield Problem(("cameras", name), text)


def _old_cflib() -> str:
    """Return the version of cflib if it supports only the legacy dongle mode, else ''."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        installed = version("cflib")
    except PackageNotFoundError:
        return ""
    from packaging.version import Version  # a dependency of cflib

    return installed if Version(installed) <= Version(LEGACY) else ""


def _dongle(uri: str | None) -> str | None:
    """Return the number or serial of the dongle of a link; None if it uses none."""
    radio = RadioAddress.of(uri or "")
    return None if radio is None else radio.dongle


@hookimpl
def star_transports() -> Iterable[TransportSpec]:
    yield TransportSpec(
        name="radio",
        summary="Crazyflies by their links' addresses: radio, UDP, TCP or USB.",
        make=make,
        options=OPTIONS,
        check=check,
        realtime=True,
    )
