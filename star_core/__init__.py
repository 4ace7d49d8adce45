"""What authors of plugins and of scripts need, and nothing else.

The names are those of `__init__.pyi`. They are imported when they are first used (PEP 562, SPEC 1),
so that a plugin that only announces itself costs no numpy.
"""

from importlib import import_module

with open(f"{__file__}i", encoding="utf-8") as _stub:  # noqa: PTH123 -- `pathlib` is slow
    _lines = [line.split() for line in _stub if line.startswith("from ")]
_home = {name: module for _, module, _, name, *_ in _lines}

__all__ = sorted(_home)  # noqa: PLE0605 -- of strings


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("star-swarm")
    if name not in _home:
        raise AttributeError(f"module 'star_core' has no attribute {name!r}")
    return getattr(import_module(_home[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
