"""Opens a page whose address has a token, which no other user of the machine may see."""

from __future__ import annotations

import contextlib
import html
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path

PAGE = """<!doctype html>
<meta charset="utf-8"><meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0; url={address}">
<p><a href="{address}">rcmqp</a></p>
"""


@contextlib.contextmanager
def opening() -> Iterator[Callable[[str], None]]:
    """Yield a function that opens an address in the browser, until the block ends.

    Everybody can read the arguments of a process, so the browser is given a file that only this
    user can read, and which leads to the address.
    """
    with tempfile.TemporaryDirectory(prefix="rcmqp-") as folder:

        def show(address: str) -> None:
            file = Path(folder) / "open.html"
            file.touch(0o600)
            file.write_text(PAGE.format(address=html.escape(address)), encoding="utf-8")
            webbrowser.open(file.as_uri())

        yield show
