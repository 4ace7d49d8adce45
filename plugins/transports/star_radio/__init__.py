"""Transport ``radio``: Crazyflies reached through cflib, or simulated by ``star fleet``.

Commands: ``star scan`` finds them, ``star preflight`` checks whether they can fly a mission, and
``star land`` lands those that no program flies any more.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from star_core import Problem, TransportSpec, deferred, hookimpl
from star_core.commands import CommandSpec
from star_core.toolkit import suggestion
from star_radio import budget
from star_radio.address import RadioAddress, camera_faults, faults
from star_radio.options import options_with

if TYPE_CHECKING:
    from star_core import Registry, Scene, Transport


LEGACY = "0.1.34"  # the last cflib version known to support only the legacy Crazyradio mode


def make(scene: Scene, **options: Any) -> Transport:
    """Return the transport for a scene's agents; its links are not open yet.

    Raises:
        PluginError: The motion-capture system or, without a guardian, the dongle for broadcasts is
            not available.
    """
    from star_radio.guarded import GuardedRadio
    from star_radio.options import RadioOptions
    from star_radio.transport import Radio

    return (GuardedRadio if options["guardian"] else Radio)(scene, RadioOptions(**options))


def check(scene: Scene, **options: Any) -> Iterable[Problem]:
    """Yield agents with unusable addresses, overloaded dongles and missing packages."""
    from importlib.util import find_spec

    mode, broadcast = options["mode"], options["broadcast"]
    if find_spec("cflib") is None:
        text = "it needs the package 'cflib': pip install 'star-swarm[radio]'"
        yield Problem((), text, "missing-package")
    if options["mocap"] is not None:
        from star_radio.mocap import problems

        yield from problems(scene, options["mocap"])
    if options["watchdog"] and scene.period > 0.5:  # noqa: PLR2004 -- s; its time is 1 s
        text = f"it needs a tick of 0.5 s or less, got {scene.period:g} s"
        yield Problem(("watchdog",), text, "out-of-range")
    yield from faults(scene.agents)
    uris = [agent.uri for agent in scene.agents if agent.uri]
    if mode == "inline" and budget.shared(uris) and (old := _old_cflib()):
        text = f"cflib {old} does not support this mode; remove the option"
        yield Problem(("mode",), text, "option-conflict")
    overloads = budget.overloads(uris, mode, scene.period, options["report_period"])
    yield from (Problem((), overload, "radio-overload") for overload in overloads)
    links = [agent for agent in scene.agents if _dongle(agent.uri) == str(broadcast)]
    if links:
        text = f"dongle {broadcast} carries the link of agent {links[0].name!r}: expected another"
        yield Problem(("broadcast",), text, "option-conflict")
    for name in options["agent_parameters"]:
        if name not in scene.names:
            text = f"no agent named {name!r}{suggestion(name, scene.names, 'there are')}"
            yield Problem(("agent_parameters", name), text, "unknown-agent")
    yield from camera_faults(scene, options["cameras"])


def flow_deck(*, flow_deck: bool, **_others: Any) -> bool:
    """Return whether the drones carry Flow decks, which measure heights from what is below."""
    return flow_deck


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
    """Return the number or serial of the dongle of a link, if it uses one."""
    radio = RadioAddress.of(uri or "")
    return None if radio is None else radio.dongle


@hookimpl
def star_transports(registry: Registry) -> Iterable[TransportSpec]:
    yield TransportSpec(
        name="radio",
        summary="Crazyflies by their links' addresses: radio, UDP, TCP or USB.",
        make=make,
        options=options_with(registry),
        check=check,
        heights_above_surface=flow_deck,
        flow_deck=flow_deck,
    )


COMMANDS = {
    "scan": "List the drones that answer: firmware, battery, decks and link.",
    "preflight": "Check whether the drones of a mission can fly it.",
    "camera": "Show what a camera sees, with the tags in it, in the browser.",
    "land": "Land drones that no program flies any more, by their links.",
}


@hookimpl
def star_commands() -> Iterable[CommandSpec]:
    for name, summary in COMMANDS.items():
        yield CommandSpec(
            name=name,
            summary=summary,
            configure=deferred(f"star_radio.{name}_command:configure"),
            run=deferred(f"star_radio.{name}_command:run"),
            group="Hardware",
        )
