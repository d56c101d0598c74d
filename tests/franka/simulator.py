"""An open simulator of Franka's control interface, made and started for a test.

It is ``franka-sim`` from PyPI, which needs an older numpy than rcmqp and has an environment of
its own; the arm's masses and shapes are those that ``franky-sim`` ships.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("franka-sim==1.1.7", "franky-sim==1.0.4")
"""From PyPI; of the second only the model is used, so it comes without what it depends on."""

FOLDER = Path(os.environ.get("RCMQP_FRANKA_ENV", Path(__file__).parents[2])) / ".venv-franka"
"""Where the environment is kept: in the checkout, or in the folder that RCMQP_FRANKA_ENV names."""

PORT = 1337
"""Of Franka's interface: the client knows no other."""

START = 60.0
"""How long the simulator may take to answer [s]."""


class SimulatorError(Exception):
    """The simulator cannot be installed, or does not come up."""


@dataclass(frozen=True, slots=True)
class Simulator:
    """A simulator that runs.

    Attributes:
        address: where Franka's client finds it.
        log: what it writes.
    """

    address: str
    log: Path

    def complaints(self) -> list[str]:
        """What it has objected to so far, with the numbers that its client does not pass on."""
        lines = self.log.read_text(encoding="utf-8").splitlines()
        return [line.partition(" ")[2] for line in lines if line.startswith("WARNING")]


def environment(folder: Path = FOLDER) -> Path:
    """The simulator's interpreter; its environment is made the first time.

    Raises:
        SimulatorError: pip cannot install it.
    """
    python, done, wanted = folder / "bin" / "python", folder / "installed.txt", "\n".join(PACKAGES)
    if done.is_file() and done.read_text(encoding="utf-8") == wanted:
        return python
    print(f"installing Franka's simulator into {folder}", file=sys.stderr)
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    simulator, model = PACKAGES
    try:
        venv.create(folder, with_pip=True, clear=True)
        for arguments in ([simulator], ["--no-deps", model]):
            subprocess.run([*pip, *arguments], check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError) as error:
        last = (str(getattr(error, "stderr", "") or "").strip().splitlines() or [str(error)])[-1]
        raise SimulatorError(
            f"{' and '.join(PACKAGES)} cannot be installed into {folder} ({last}); this needs "
            "PyPI once, and nothing of the rest does: run the other tests with make test"
        ) from error
    assets = next(folder.glob("lib/python*/site-packages/franky_sim/assets"))
    model_folder = folder / "model"
    model_folder.mkdir()
    (model_folder / "fr3.xml").symlink_to(assets / "fr3.xml")
    (model_folder / "assets").symlink_to(assets / "meshes")  # where the model looks for them
    done.write_text(wanted, encoding="utf-8")
    return python


@contextlib.contextmanager
def simulator() -> Iterator[Simulator]:
    """Start a simulator, and end it afterwards.

    Each has an address of its own on this machine's loopback, 127.x.y.z by the process's number,
    as the port is always the same.

    Raises:
        SimulatorError: it cannot be installed, or does not answer in time.
    """
    python, number = environment(), os.getpid()
    address = f"127.{1 + (number >> 16) % 254}.{(number >> 8) % 256}.{1 + number % 254}"
    if _answers(address):
        raise SimulatorError(f"something else has {address}:{PORT}; end it and try again")
    command = [str(python), str(Path(__file__).with_name("serve.py")), address]
    model = os.environ | {"FR3_MJCF": str(FOLDER / "model" / "fr3.xml")}
    with tempfile.TemporaryDirectory() as scratch:
        running = Simulator(address, Path(scratch) / "log.txt")
        with running.log.open("w", encoding="utf-8") as log:
            process = subprocess.Popen(command, stdout=log, stderr=log, env=model, process_group=0)
        try:
            _wait(process, running)
            yield running
        finally:
            process.terminate()
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _wait(process: subprocess.Popen[bytes], running: Simulator) -> None:
    """Until it answers."""
    until = time.monotonic() + START
    while not _answers(running.address):
        if process.poll() is None and time.monotonic() < until:
            time.sleep(0.1)
            continue
        said = running.log.read_text(encoding="utf-8")[-2000:]
        raise SimulatorError(
            f"Franka's simulator does not answer at {running.address}:{PORT}:\n{said}"
        )


def _answers(address: str) -> bool:
    with socket.socket() as asked:
        asked.settimeout(1.0)
        return asked.connect_ex((address, PORT)) == 0
