"""The list of commands that ``star --help`` prints.

Loading every plugin takes ten times as long as Python needs to start, so the list is kept in a
cache file. It is used as long as the folders and files that it was made from have the same
modification times: those on the module search path (installing a distribution changes one) and
those of the plugins.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # what type checkers take for true; `typing` itself is slow to import
if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from star_core.registry import Registry

GROUPS = ("Fly", "Review", "Author", "Study", "Hardware", "Plugins")
FIRST_LINE = "star commands 1"  # version of the file's format


def overview(registry: Callable[[], Registry]) -> str:
    """Return all commands by group, from the cache or else from the registry."""
    cache = _cache_file()
    text = _cached(cache)
    if text is None:
        plugins = registry()
        text = _listed(plugins)
        if not plugins.broken:  # broken plugins are reported each time
            _keep(cache, _stamps(_sources(plugins)), text)
    return text


def _listed(registry: Registry) -> str:
    """Return the text of the list; commands of one name are all listed."""
    groups: dict[str, list[str]] = {group: [] for group in GROUPS}
    for kind, found in registry:
        if kind == "command":
            line = f"  {found.offer.name:<12}{found.offer.summary}"
            groups.setdefault(found.offer.group, []).append(line)
    parts = ["Missions for drone swarms, from one YAML file."]
    parts += ["\n".join([group, *lines]) for group, lines in groups.items() if lines]
    return "\n\n".join([*parts, "`star COMMAND --help` describes a command."])


def _cache_file() -> str:
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return os.path.join(base, "star", sys.prefix.replace(os.sep, "%") + ".commands")


def _cached(file: str) -> str | None:
    try:
        with open(file, encoding="utf-8") as stream:
            stamps, _, text = stream.read().partition("\n\n")
    except (OSError, ValueError):
        return None
    paths = [line.partition(" ")[2] for line in stamps.splitlines()[1 + len(sys.path) :]]
    return text if stamps == _stamps(paths) else None


def _stamps(files: Iterable[str]) -> str:
    """Return one line for each folder of the search path and each file: its time and its path."""
    lines = [f"{_modified(path)} {path}" for path in (*sys.path, *files)]
    return "\n".join([FIRST_LINE, *lines])


def _modified(path: str) -> int:
    try:
        return os.stat(path or os.curdir).st_mtime_ns
    except OSError:
        return 0


def _sources(registry: Registry) -> list[str]:
    """Return the files of the plugins' packages that have been imported."""
    plugins = registry.manager.plugins.values()
    names = {getattr(plugin, "__name__", type(plugin).__module__) for plugin in plugins}
    packages = {name.partition(".")[0] for name in names}
    modules = [(name, module) for name, module in sys.modules.items() if name]
    files = (getattr(m, "__file__", None) for n, m in modules if n.partition(".")[0] in packages)
    return sorted({file for file in files if file})


def _keep(file: str, stamps: str, text: str) -> None:
    """Write the cache, if that is possible."""
    temporary = f"{file}.{os.getpid()}"
    try:
        os.makedirs(os.path.dirname(file), exist_ok=True)
        with open(temporary, "w", encoding="utf-8") as stream:
            stream.write(f"{stamps}\n\n{text}")
        os.replace(temporary, file)
    except OSError:
        pass
