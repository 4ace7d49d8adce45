"""Figures of the structure: lines of code, names of the API, floors of imports.

Run as ``python benchmarks/figures.py``. A floor of `star_core` is a set of its packages and modules
that import lower floors only; imports for type checkers count too. A cycle is printed.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Final

import grimp

from star_core.lazy_names import lazy_names

ROOT: Final = Path(__file__).parents[1]
APIS: Final = ("", "toolkit", "commands", "formats", "testing")


def lines(*folders: str) -> int:
    """Return the number of lines of Python in some folders."""
    files = (file for folder in folders for file in (ROOT / folder).rglob("*.py"))
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def imports() -> dict[str, set[str]]:
    """Return what each package and module in `star_core` imports from the others."""
    graph = grimp.build_graph("star_core", cache_dir=None)
    arrows: dict[str, set[str]] = defaultdict(set)
    for importer in graph.modules - {"star_core"}:
        arrows[_part(importer)].update(
            _part(imported)
            for imported in graph.find_modules_directly_imported_by(importer) - {"star_core"}
            if _part(imported) != _part(importer)
        )
    return dict(arrows)


def floors(arrows: Mapping[str, set[str]]) -> Iterator[list[str]]:
    """Yield the parts of each floor, the lowest first.

    Raises:
        CycleError: Parts import each other.
    """
    sorter = TopologicalSorter(arrows)
    sorter.prepare()
    while sorter.is_active():
        floor = sorter.get_ready()
        sorter.done(*floor)
        yield sorted(floor)


def _part(module: str) -> str:
    return module.split(".")[1]


def main() -> None:
    """Print the figures."""
    core, plugins = lines("star_core"), lines("plugins")
    print(f"star_core    {core:7,} lines")
    print(f"plugins      {plugins:7,} lines")
    print(f"product      {core + plugins:7,} lines")
    print(f"tests        {lines('tests'):7,} lines")
    print(f"benchmarks   {lines('benchmarks'):7,} lines")
    for api in APIS:
        name = f"star_core{f'.{api}' if api else ''}"
        names, _, _ = lazy_names(name, str(ROOT / "star_core" / api / "__init__.py"))
        print(f"{len(names):6} names in {name}")
    arrows = imports()
    try:
        levels = [*floors(arrows)]
    except CycleError as error:
        print(f"cycle of imports: {' -> '.join(error.args[1])}")
    else:
        print(f"{len(levels):6} floors of imports, {sum(map(len, arrows.values()))} arrows")
        for number, parts in reversed([*enumerate(levels, 1)]):
            print(f"{number:10}  {', '.join(parts)}")


if __name__ == "__main__":
    main()
