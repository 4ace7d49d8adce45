"""Attacks on the page of ``star camera``."""

from __future__ import annotations

import pytest

from star_radio.camera_command import Server
from tests.plugins.transports.star_radio.test_camera_command import deck, get, server

__all__ = ["deck", "server"]


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {}),
        ("/picture", {}),
        ("/wrong-token-of-some-length/", {}),
        ("TOKEN", {"Host": "evil.example:80"}),
        ("TOKEN", {"Origin": "http://evil.example"}),
        ("TOKENpicture", {"Origin": "null"}),
    ],
)
def test_foreign_requests_are_forbidden(server: Server, path: str, headers: dict[str, str]) -> None:
    path = path.replace("TOKEN", f"/{server.token}/")
    assert get(server, path, **headers).status == 403


def test_the_page_is_served_on_the_loopback_interface_only(server: Server) -> None:
    assert server.server_address[0] == "127.0.0.1"
    assert server.address.startswith("http://127.0.0.1:")
