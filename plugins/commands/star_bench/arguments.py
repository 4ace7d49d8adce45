"""Arguments of the options ``--avoiders`` and ``--scenarios``: a name and its options."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, Final

from star_core import InputError, PluginError, Registry

NOT_IN_LABELS: Final = re.compile(r"[^A-Za-z0-9 _.+-]")


def named(flag: str, word: str) -> tuple[str, dict[str, Any]]:
    """Return the name and the options of a word such as ``orca=radius:0.25,horizon:2``.

    >>> named("--avoiders", "orca=radius:0.25,obstacles:none")
    ('orca', {'radius': 0.25, 'obstacles': 'none'})

    Raises:
        InputError: The word has another form.
    """
    name, equals, text = word.partition("=")
    options: dict[str, Any] = {}
    for part in text.split(",") if equals else ():
        key, colon, value = part.partition(":")
        if not (name and key and colon and value):
            wrong = f"{flag} {word!r}: expected NAME or NAME=OPTION:VALUE,OPTION:VALUE"
            raise InputError(wrong, "invalid-argument")
        try:
            options[key.strip()] = json.loads(value)
        except ValueError:
            options[key.strip()] = value.strip()
    return name, options


def levels(words: list[str], registry: Registry) -> dict[str, Any]:
    """Return the overrides of a mission for each avoider, by the label used in tables.

    Args:
        words: Values of the flag; empty for all installed avoiders.
        registry: Registry of the avoiders.

    Raises:
        InputError: There is no avoider of that name, or one is given twice.
    """
    found: dict[str, Any] = {}
    for word in words or registry.names("avoider"):
        name, options = named("--avoiders", word)
        try:
            registry.find("avoider", name)
        except PluginError as error:
            raise InputError(f"--avoiders: {error}", "unknown-plugin") from None
        label = label_of(name, options)
        if label in found:
            raise InputError(f"--avoiders: {label!r} is given twice", "duplicate-name")
        found[label] = {"use": name, **options} if options else name
    return found


def label_of(name: str, options: Mapping[str, Any]) -> str:
    """Return the label of a plugin with its options in tables: ``orca radius 0.25``."""
    return NOT_IN_LABELS.sub(
        "_", " ".join([name, *(f"{key} {value}" for key, value in options.items())])
    )
