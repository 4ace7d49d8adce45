"""The claims of docs/security.md."""

from __future__ import annotations

import ast
import json
import re
import socket
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_basics.land_requests import listening
from star_core import InputError, Operator, Registry, load, read_run
from star_core.commands.main import main
from star_core.world.scene import inside
from star_external.tcp_server import TcpServer
from star_yaml.yaml_reader import parse
from tests.conftest import HOP

ROOT = Path(__file__).parents[2]
SCRIPT = "</script><script>alert(1)</script>"


def test_each_claim_names_its_tests() -> None:
    claimed = set(re.findall(r"`(test_\w+)`", (ROOT / "docs/security.md").read_text()))
    tests = {
        node.name
        for file in (ROOT / "tests").rglob("test_security*.py")
        for node in ast.parse(file.read_text()).body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }
    assert claimed == tests - {"test_each_claim_names_its_tests"}


@pytest.mark.parametrize(
    "text", ["a: !!python/object/apply:os.system [ls]", "a: !exec ls", "a: &x 1", "%YAML 1.1\n---"]
)
def test_yaml_makes_no_objects(text: str) -> None:
    with pytest.raises(InputError) as refused:
        parse(text, "m.yaml")
    assert refused.value.code == "invalid-yaml"


def test_a_name_in_a_mission_is_not_imported(hop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (hop / "evil_star.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(hop)
    for old, new, code in [
        ("avoider: orca", "avoider: evil_star", "unknown-plugin"),
        ("land:", "evil_star:", "unknown-verb"),
    ]:
        (hop / "hop.yaml").write_text(HOP.replace(old, new))
        with pytest.raises(InputError) as refused:
            load(hop / "hop.yaml", Registry())
        assert refused.value.code == code
    assert "evil_star" not in sys.modules


def test_small_files_stay_small() -> None:
    levels = [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    for text in ["a0: &a0 [x]\n" + "\n".join(levels), "a: " + "[" * 1000]:
        with pytest.raises(InputError):
            parse(text, "m.yaml")


def test_files_are_inside_the_folder(hop: Path) -> None:
    mission = hop / "mission"
    mission.mkdir()
    (mission / "link.yaml").symlink_to(hop / "room.yaml")
    for name in ["../room.yaml", "link.yaml", str(hop / "room.yaml")]:
        with pytest.raises(InputError):
            inside(mission, name)


def test_records_are_not_unpickled(hop: Path) -> None:
    assert main(["run", str(hop / "hop.yaml"), "--out", str(hop / "run")]) == 0
    read_run(hop / "run")
    np.savez(hop / "run/trajectory.npz", agents=np.array([object()], dtype=object))
    with pytest.raises(InputError) as refused:
        read_run(hop / "run")
    assert refused.value.code == "no-record"


def test_only_pipes_carry_pickles() -> None:
    readers = set()
    for top in ("star_core", "plugins"):
        for file in (ROOT / top).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                name = ast.unparse(node) if isinstance(node, ast.Attribute) else ""
                if name.startswith("pickle.load") or name.endswith("connection.recv"):
                    readers.add(file.parent.name + "/" + file.name)
                if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                    readers.add(file.name)
    readers -= {"star_view/gate.py"}  # a web socket
    assert readers == {
        *("star_ablate/flight.py", "star_ablate/workers.py", "star_apriltag/worker_pool.py"),
        *("star_mcap/process.py", "star_mocap/source_process.py", "star_mocap/system.py"),
        *("star_radio/guarded.py", "star_radio/guardian.py", "star_radio/mailbox.py"),
        "toolkit/processes.py",
    }  # but not `star_view/live_view.py`: it listens to the process that serves browsers


def test_servers_listen_on_the_loopback_address() -> None:
    external = Registry().find("task", "external").offer.options["properties"]
    assert external["listen"]["default"] == "127.0.0.1"
    for file in (ROOT / "plugins").rglob("*.py"):
        for host in re.findall(
            r"host: str = \"(.*?)\"|\"--host\", default=\"(.*?)\"", file.read_text()
        ):
            assert "127.0.0.1" in host, file


@pytest.mark.parametrize(
    ("first", "obeyed"),
    [
        ('{"token": "secret"}', True),
        ('{"token": "other"}', False),
        ('{"token": null}', False),
        ('{"goals": {}}', False),
        ("[" * 9000, False),
        ("", False),
    ],
)
def test_other_hosts_need_the_token(first: str, *, obeyed: bool) -> None:
    server = TcpServer("127.0.0.1", 0, token="secret")  # noqa: S106
    with socket.create_connection(server.address, timeout=5.0) as client:
        client.sendall(f'{first}\n{{"done": true}}\n'.encode())
        assert server.accept(0.3) is obeyed
        assert server.send(b"state\n") is obeyed
        assert len(server.receive(9, 0.1)) == obeyed
    server.close()


def test_reports_escape_text(hop: Path) -> None:
    pytest.importorskip("plotly")
    assert main(["run", str(hop / "hop.yaml"), "--out", str(hop / "run")]) == 0
    for name in ("summary.json", "manifest.json"):
        file = hop / "run" / name
        file.write_text(json.dumps(_poisoned(json.loads(file.read_text()))))
    assert main(["report", str(hop / "run")]) == 0
    page = (hop / "run/report.html").read_text()
    assert SCRIPT not in page
    assert "alert(1)" in page


def _poisoned(value: Any, key: str = "") -> Any:
    """Return a record with a script in each text that comes from a mission."""
    if isinstance(value, dict):
        return {name: _poisoned(each, name) for name, each in value.items()}
    if isinstance(value, list):
        return [_poisoned(each, key) for each in value]
    texts = {"reason", "mission", "text", "mission_file", "verb", "source"}
    return f"{value}{SCRIPT}" if key in texts and isinstance(value, str) else value


def test_plugins_are_allowed_and_blocked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("one_star", "two_star"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('loaded')")
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Name: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[star.plugins]\n{name} = {name}\n")

    def tried(**environment: str) -> set[str]:
        with monkeypatch.context() as patch:
            for name, value in environment.items():
                patch.setenv(name, value)
            plugins = Registry()
            assert "sim" in plugins.names("transport")
            return {source.plugin for source in plugins.broken}

    assert tried() == {"one_star:one_star", "two_star:two_star"}
    assert tried(STAR_ALLOW_PLUGINS="one_star") == {"one_star:one_star"}
    assert tried(STAR_ALLOW_PLUGINS="") == set()
    assert tried(STAR_BLOCK_PLUGINS="one_star") == {"two_star:two_star"}


def test_a_flight_opens_no_connection(hop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []
    original = socket.socket.connect

    def connect(self: socket.socket, address: Any) -> None:
        if self.family != socket.AF_UNIX:
            opened.append(address)
        original(self, address)

    monkeypatch.setattr(socket.socket, "connect", connect)
    assert main(["run", str(hop / "hop.yaml"), "--no-record"]) == 0
    assert opened == []


def test_only_the_user_can_stop_a_flight(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    shared = tmp_path / "star-swarm"
    shared.mkdir()
    shared.chmod(0o755)
    assert main(["stop"]) == 2
    text = "is not a folder that only you can open; remove it [unwritable-file]"
    assert text in capsys.readouterr().err
    with listening(Operator(), "demo"):
        assert "`star stop` cannot land this flight" in caplog.text
    assert list(shared.iterdir()) == []
