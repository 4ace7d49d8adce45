"""Checks of the options of ``external`` beyond the schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from ipaddress import AddressValueError, IPv4Address
from typing import TYPE_CHECKING, Any, Final

from star_core import PluginError, Problem
from star_external.planner_registry import chosen
from star_external.rates import ticks_between

if TYPE_CHECKING:
    from star_core import Scene

PROCESS_DEFAULTS: Final[Mapping[str, Any]] = {
    "port": 5799,
    "listen": "127.0.0.1",
    "silence": 2.0,
    "then": "hold",
    "response_timeout": 10.0,
    "lockstep": True,
}  # of the options that apply only to another process


def check(
    scene: Scene, _rows: tuple[int, ...], *, planner: str | None = None, **options: Any
) -> Iterator[Problem]:
    """Yield problems with these options."""
    yield from _other_process(scene, options) if planner is None else _planner(planner, options)


def _planner(name: str, options: dict[str, Any]) -> Iterator[Problem]:
    """Yield a planner that is not installed, and options that apply only to another process."""
    try:
        chosen(name)
    except PluginError as error:
        yield Problem(("planner",), str(error))
    for option, default in PROCESS_DEFAULTS.items():
        if options[option] != default:
            yield Problem(
                (option,),
                f"{option!r} applies to another process, but planner {name!r} runs in this one; "
                "remove one of the two",
            )


def _other_process(scene: Scene, options: dict[str, Any]) -> Iterator[Problem]:
    """Yield an invalid address, and a silence shorter than the period of state lines."""
    try:
        IPv4Address(options["listen"])
    except AddressValueError:
        yield Problem(
            ("listen",),
            f"{options['listen']!r} is not an IPv4 address, expected one like 127.0.0.1",
        )
    apart = ticks_between(options.get("rate"), scene.period) * scene.period
    silence = options["silence"]
    if silence <= apart:
        yield Problem(
            ("rate",) if silence == PROCESS_DEFAULTS["silence"] else ("silence",),
            f"a silence of {silence:g} s is not longer than the period of state lines, {apart:g} s",
        )
