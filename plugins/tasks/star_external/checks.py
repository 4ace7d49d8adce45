"""What is wrong with the options of ``external`` that a schema cannot see."""

from __future__ import annotations

from collections.abc import Iterator
from ipaddress import AddressValueError, IPv4Address
from typing import TYPE_CHECKING, Any, Final

from star_core import PluginError, Problem
from star_external.choice import chosen
from star_external.rates import ticks_between

if TYPE_CHECKING:
    from star_core import Scene

OF_ANOTHER: Final = ("port", "listen", "silence", "then", "patience", "lockstep")
"""Options that say how another process is dealt with."""


def check(
    scene: Scene, _rows: tuple[int, ...], *, planner: str | None = None, **options: Any
) -> Iterator[Problem]:
    """Yield why these options cannot be flown with."""
    yield from _other_process(scene, options) if planner is None else _planner(planner, options)


def _planner(name: str, options: dict[str, Any]) -> Iterator[Problem]:
    """Yield that a planner is not installed, and what is said of another process beside it."""
    try:
        chosen(name)
    except PluginError as error:
        yield Problem(("planner",), str(error))
    for option in OF_ANOTHER:
        if option in options:
            yield Problem(
                (option,),
                f"planner {name!r} runs in this process and answers whenever it is asked; "
                f"{option!r} is for another process: leave out one of the two",
            )


def _other_process(scene: Scene, options: dict[str, Any]) -> Iterator[Problem]:
    """Yield an address that is none, and a silence that is over before the next state line."""
    if "listen" in options:
        try:
            IPv4Address(options["listen"])
        except AddressValueError:
            yield Problem(
                ("listen",),
                f"{options['listen']!r} is no IPv4 address, expected one like 127.0.0.1",
            )
    apart = ticks_between(options.get("rate"), scene.period) * scene.period
    silence = options.get("silence", 2.0)
    if silence <= apart:
        path = ("silence",) if "silence" in options else ("rate",)
        yield Problem(
            path,
            f"a silence of {silence:g} s is not longer than from one state line to the next, "
            f"{apart:g} s",
        )
