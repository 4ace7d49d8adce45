"""Programs as clients: ``star fleet MISSION -- python SCRIPT.py``."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from star_core import InputError
from star_fleet.client_script import launched
from tests.commands import command

run = command("fleet")

FIRST = str(Path(__file__).parents[4] / "missions" / "first_flight.yaml")
SCRIPT = """
import sys
import cflib.crtp
from cflib.crazyflie import Crazyflie
from cflib.crazyflie.syncCrazyflie import SyncCrazyflie
from beside import STATUS

cflib.crtp.init_drivers()
assert cflib.crtp.scan_interfaces(0xE7E7E7E702)[0][0] == "radio://0/80/2M/E7E7E7E702"
with SyncCrazyflie("radio://0/80/2M/E7E7E7E702", cf=Crazyflie()) as drone:
    print(drone.cf.link_uri, drone.cf.platform.get_protocol_version(), *sys.argv[1:])
sys.exit(STATUS)
"""


def test_a_script_reaches_drones_by_their_radio_addresses(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("cflib")
    (tmp_path / "beside.py").write_text("STATUS = 7\n")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    assert run([FIRST, "--port", "0", "--", sys.executable, str(script), "--fast"]) == 7
    output = capfd.readouterr()
    assert output.out.endswith("radio://0/80/2M/E7E7E7E702 12 --fast\n")
    assert "radio://0/80/2M/E7E7E7E702 is cf2, udp://127.0.0.1:" in output.err


@pytest.mark.extended
def test_a_command_of_star_flies_the_drones_of_the_fleet(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("cflib")
    script = tmp_path / "names.py"
    script.write_text(
        "from crazyflie_py import Crazyswarm\n"
        "for cf in Crazyswarm().allcfs.crazyflies:\n"
        "    print(cf.name, cf.uri)\n"
    )
    star = str(Path(sys.executable).parent / "star")
    flight = [star, "script", str(script), "--swarm", FIRST, "--no-record"]
    assert run([FIRST, "--port", "0", "--", *flight]) == 0
    lines = capfd.readouterr().out.splitlines()
    for name in ("cf1", "cf2", "cf3"):
        assert any(line.startswith(f"{name} udp://127.0.0.1:") for line in lines), lines


def test_a_script_is_terminated_when_the_time_of_the_fleet_is_over(tmp_path: Path) -> None:
    script = tmp_path / "endless.py"
    script.write_text("import time\ntime.sleep(600)\n")
    words = ["--port", "0", "--duration", "0.1", "--", sys.executable, str(script)]
    assert run([FIRST, *words]) == 128 + 15


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["python"], "invalid-option"),
        (["python", "-m", "hover"], "invalid-option"),
        (["star", "--version"], "invalid-option"),
        (["./hover.py"], "invalid-option"),
        (["python3.11", "nowhere/hover.py"], "file-not-found"),
    ],
)
def test_what_is_no_python_script_is_refused(words: list[str], code: str) -> None:
    with pytest.raises(InputError) as error:
        launched(words)
    assert error.value.code == code
    assert " ".join(words) in str(error.value)
