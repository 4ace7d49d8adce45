"""Public names that are imported when they are first used (PEP 562, SPEC 1).

So a plugin that only announces itself costs no numpy.
"""

from collections.abc import Callable
from importlib import import_module


def lazy_names(
    package: str, file: str
) -> tuple[list[str], Callable[[str], object], Callable[[], list[str]]]:
    """Return ``__all__``, ``__getattr__`` and ``__dir__`` of a package with the names of its stub.

    Args:
        package: Its ``__name__``.
        file: Its ``__file__``, beside which the stub ``__init__.pyi`` lists the names, each on a
            line ``from MODULE import NAME as NAME``.
    """
    with open(f"{file}i", encoding="utf-8") as stub:  # noqa: PTH123 -- `pathlib` is slow
        lines = [line.split() for line in stub if line.startswith("from ")]
    modules = {name: module for _, module, _, name, *_ in lines}
    names = sorted(modules)

    def get(name: str) -> object:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name)
        return getattr(import_module(modules[name]), name)

    return names, get, lambda: names
