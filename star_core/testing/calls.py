"""Calls of plugins that are made alike, with the comparisons that all checks share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from time import perf_counter
from typing import Any, Final, TypeAlias

import numpy as np

from star_core.errors import ContractError
from star_core.messages.arrays import Mask
from star_core.plugin_support.guard import require_methods
from star_core.world.scene import Scene

Times: TypeAlias = Mapping[int, float]
Case: TypeAlias = tuple[str, tuple[Any, ...]]

SIZES: Final = (1, 2, 50)

reports: list[str] = []
"""A line on each check of this process, with its times."""


def check_method(
    make: Callable[[Scene], Any],
    contract: type,
    method: str,
    scene: Callable[[int], Scene],
    cases: Callable[[Scene], Iterator[Case]],
    check: Callable[..., object],
) -> Times:
    """Check one method of two plugins made alike with the same inputs; return the times."""
    means = {}
    for n in SIZES:
        room = scene(n)
        plugins = [make(room), make(room)]
        require_methods(plugins[0], contract)
        took = []
        for label, inputs in cases(room):
            with labeled(f"{contract.__name__.lower()} of {agents_of(n)}, {label}"):
                output, elapsed = called_alike(plugins, method, inputs)
                took.append(elapsed)
                check(output, *inputs)
        close_all(plugins)
        means[n] = float(np.mean(took[1:]))
    return reported(plugins[0], means)


def called_alike(plugins: Sequence[Any], method: str, inputs: tuple[Any, ...]) -> tuple[Any, float]:
    """Return the output and time, s, of the first plugin, after comparing the others' outputs.

    Raises:
        ContractError: They differ, or an input was changed.
    """
    before = [(name, np.copy(leaf)) for name, leaf in _leaves(inputs) if _is_array(leaf)]
    outputs = []
    for plugin in plugins:
        begun = perf_counter()
        outputs.append(getattr(plugin, method)(*inputs))
        elapsed = perf_counter() - begun
    after = (leaf for _, leaf in _leaves(inputs) if _is_array(leaf))
    for (name, old), new in zip(before, after, strict=True):
        if not _equal(old, new):
            raise ContractError(
                f"{method}() changed {name} of its input: make another table by "
                "dataclasses.replace, and copy arrays before you change them"
            )
    for other in outputs[1:]:
        require_same(outputs[0], other)
    return outputs[0], elapsed


def require_same(first: Any, second: Any) -> None:
    for (name, leaf), (_, again) in zip(_leaves(first), _leaves(second), strict=False):
        if not _equal(leaf, again):
            raise ContractError(
                f"two plugins that were made alike return different {name or 'values'} for the "
                "same inputs: draw random numbers from numpy.random.default_rng([scene.seed, a "
                "constant of your own]), read no clock, and share nothing between plugins"
            )


def require_inactive(active: Mask, allowed: Mask, name: str) -> None:
    if (wrong := active & ~allowed).any():
        raise ContractError(
            f"row {int(np.argmax(wrong))} is not active in {name}, but active in the result: such "
            f"an agent is on the ground or has no goal; copy {name}.active"
        )


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield what a table consists of, with names such as ``Plan.setpoint.velocity``."""
    if is_dataclass(value):
        owner = name or type(value).__name__
        for field in fields(value):
            yield from _leaves(getattr(value, field.name), f"{owner}.{field.name}")
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from _leaves(item, f"{name}[{i}]" if name else "")
    else:
        yield name, value


def _is_array(leaf: Any) -> bool:
    return isinstance(leaf, np.ndarray)


def _equal(first: Any, second: Any) -> bool:
    if _is_array(first) and _is_array(second):
        return np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
    return bool(first == second)


def agents_of(n: int) -> str:
    return f"{n} agent{'s' if n > 1 else ''}"


@contextmanager
def labeled(label: str) -> Iterator[None]:
    """Put a label before the message of a contract error, and beside any other."""
    try:
        yield
    except ContractError as error:
        raise ContractError(f"{label}: {error}") from error
    except Exception as error:
        error.add_note(
            f"{label}; agents that are not located have rows of NaN, arrays of inputs are read-only"
        )
        raise


def close_all(plugins: Sequence[Any]) -> None:
    for plugin in plugins:
        if hasattr(plugin, "close"):
            plugin.close()


def reported(plugin: object, means: dict[int, float]) -> Times:
    times = ", ".join(f"{1e3 * mean:.3f} ms with {agents_of(n)}" for n, mean in means.items())
    reports.append(f"{type(plugin).__name__}: {times} per call")
    return means
