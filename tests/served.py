"""A program of rcmqp that serves a page."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def served(command: str, *options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``rcmqp COMMAND`` without a browser, and the address of its page; killed at the end."""
    with subprocess.Popen(
        [sys.executable, "-m", "rcmqp", command, "--no-open", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    ) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().strip()
            assert address.startswith("http://127.0.0.1:"), address + process.stdout.read()
            yield process, address
        finally:
            process.kill()
