"""An environment of its own for each package that rcmqp is compared with."""

from __future__ import annotations

import subprocess
import sys
import venv
from pathlib import Path

SOLVERS = ["daqp", "proxsuite", "qpsolvers", "quadprog"]

PEERS: dict[str, list[str]] = {
    "placo": ["placo"],
    "dqrobotics": ["dqrobotics", "quadprog"],
    "roboplan": ["roboplan"],
    "pink": ["pin-pink", *SOLVERS],
    "mink": ["mink", *SOLVERS],
}
"""What each needs from PyPI; newest versions, told in the result."""

WORKERS = Path(__file__).parent / "workers"


class CannotInstall(Exception):
    """A package is not to be had here."""


def python(name: str, folder: Path) -> Path:
    """The interpreter that has a package: this one for rcmqp, else an environment in ``folder``.

    It is made the first time, and again when what it needs has changed.

    Raises:
        CannotInstall: pip says why not.
    """
    if name == "rcmqp":
        return Path(sys.executable)
    home, wanted = folder / name, "\n".join(PEERS[name])
    found, done = home / "bin" / "python", home / "installed.txt"
    if done.is_file() and done.read_text(encoding="utf-8") == wanted:
        return found
    print(f"installing {name} into {home}", file=sys.stderr)
    try:
        venv.create(home, with_pip=True, clear=True)
        pip = [str(found), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, *PEERS[name]], check=True, capture_output=True, text=True)
    except subprocess.CalledProcessError as error:
        last = (str(error.stderr or "").strip().splitlines() or [str(error)])[-1]
        raise CannotInstall(f"not installed: {last}") from error
    except OSError as error:
        raise CannotInstall(f"not installed: {error}") from error
    done.write_text(wanted, encoding="utf-8")
    return found
