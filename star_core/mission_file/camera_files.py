"""Cameras that stand in files of their own: read, and put into the mission that names them."""

from __future__ import annotations

from dataclasses import replace

from star_core.errors import InputError
from star_core.mission_file import schema
from star_core.mission_file.located_document import Document
from star_core.mission_file.yaml_source import Mark, Place
from star_core.scene import inside


def furnished(document: Document) -> Document:
    """Return a mission with each ``file`` of its ``cameras`` replaced by what stands in that file.

    A key that the mission gives itself wins; the places of the others are those in their file. What
    is no ``file`` as the schema has it stays, for the schema to complain of.

    Raises:
        InputError: A file is none inside the mission's folder, cannot be read or is no camera's;
            every reason found is listed.
    """
    cameras = document.data.get("cameras")
    named = {
        name: camera["file"]
        for name, camera in (cameras.items() if isinstance(cameras, dict) else ())
        if isinstance(camera, dict) and isinstance(camera.get("file"), str)
    }
    sources, problems = dict[str, Document](), list[str]()
    for name, file in named.items():
        try:
            sources[name] = _camera(document, name, file)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(list(dict.fromkeys(problems)))
    for name, source in sources.items():
        document = _put(document, name, source)
    return document


def _camera(document: Document, name: str, file: str) -> Document:
    """Read the file of the camera of that name.

    Raises:
        InputError: There is no such file inside the mission's folder, or it is no camera's.
    """
    try:
        path = inside(document.path.parent, file)
    except InputError as error:
        raise InputError([document.problem(("cameras", name, "file"), str(error))]) from None
    return schema.read_as(path, "camera")


def _put(document: Document, name: str, source: Document) -> Document:
    """Return a mission with what `source` says of its camera of that name."""
    cameras = document.data["cameras"]
    own = {key: value for key, value in cameras[name].items() if key != "file"}
    read = {key: value for key, value in source.data.items() if key not in {"star", "name"}}
    places = {
        ("cameras", name, *path): Place(
            *(Mark(*mark[:2], f"{source.path}:{mark.line}:{mark.column}") for mark in place)
        )
        for path, place in source.places.items()
        if path and path[0] in read.keys() - own.keys()
    }
    data = document.data | {"cameras": cameras | {name: read | own}}
    return replace(document, data=data, places={**document.places, **places})
