"""What authors of plugins and of scripts need first.

`star_core.toolkit` has what plugins share, `star_core.commands` what commands share,
`star_core.formats` what formats of missions share, and `star_core.testing` checks plugins.
The names of each package are those of its `__init__.pyi`.
"""

from star_core.lazy_names import lazy_names

__all__, _get, _names = lazy_names(__name__, __file__)


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("star-swarm")
    return _get(name)


def __dir__() -> list[str]:
    return [*_names(), "__version__"]
