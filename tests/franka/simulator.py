"""An open simulator of Franka's control interface, made and started for a test.

It is ``franka-sim`` from PyPI, which needs an older numpy than rcmqp and has an environment of
its own; the arm's masses and shapes are those that ``franky-sim`` ships.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Iterator
from pathlib import Path

PACKAGES = ("franka-sim==1.1.7", "franky-sim==1.0.4")
"""From PyPI; of the second only the model is used, so it comes without what it depends on."""

FOLDER = Path(os.environ.get("RCMQP_FRANKA_ENV", Path(__file__).parents[2] / ".venv-franka"))
"""Where the environment is kept: .venv-franka, or what RCMQP_FRANKA_ENV says."""

PORT = 1337
"""Of Franka's interface: the client knows no other."""

SLOWNESS = 2.0
"""Seconds that a second of the simulator takes: it and the loop may share a core with others."""

START = 60.0
"""How long the simulator may take to answer [s]."""


class SimulatorError(Exception):
    """The simulator cannot be installed, or does not come up."""


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
def simulator(slowness: float = SLOWNESS) -> Iterator[str]:
    """A simulator that answers at the address given, and is gone afterwards.

    Each has an address of its own on this machine's loopback, 127.x.y.z by the process's number,
    as the port is always the same.

    Args:
        slowness: seconds that a second of the simulator takes.

    Raises:
        SimulatorError: it cannot be installed, or does not answer in time.
    """
    python, number = environment(), os.getpid()
    address = f"127.{1 + (number >> 16) % 254}.{(number >> 8) % 256}.{1 + number % 254}"
    if _answers(address):
        raise SimulatorError(f"something else has {address}:{PORT}; end it and try again")
    command = [str(python), str(Path(__file__).with_name("serve.py")), address, str(slowness)]
    model = os.environ | {"FR3_MJCF": str(FOLDER / "model" / "fr3.xml")}
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(
            command, stdout=log, stderr=log, env=model, text=True, process_group=0
        )
        try:
            _wait(process, address, log)
            yield address
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _wait(process: subprocess.Popen[str], address: str, log: object) -> None:
    """Until it answers."""
    until = time.monotonic() + START
    while not _answers(address):
        if process.poll() is None and time.monotonic() < until:
            time.sleep(0.1)
            continue
        log.seek(0)  # type: ignore[attr-defined]
        said = log.read()[-2000:]  # type: ignore[attr-defined]
        raise SimulatorError(f"Franka's simulator does not answer at {address}:{PORT}:\n{said}")


def _answers(address: str) -> bool:
    with socket.socket() as asked:
        asked.settimeout(1.0)
        return asked.connect_ex((address, PORT)) == 0
