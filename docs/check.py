"""Check the built site: ``python docs/check.py docs/_build/html``.

Every link inside it leads somewhere, nothing is loaded from elsewhere, and every public name of
the package is there with its docstring.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.util.inventory import InventoryFile

import rcmqp

LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}
"""What a browser fetches without being asked, by its tag."""


class Page(HTMLParser):
    """The links of a page, what it loads, and the names that links may lead to."""

    def __init__(self, text: str) -> None:
        """Read the page."""
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.names: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what a tag leads to or loads."""
        given = dict(attrs)
        self.names |= {given[key] or "" for key in ("id", "name") if key in given}
        if tag == "a" and given.get("href"):
            self.links.append(given["href"] or "")
        if tag in LOADED and given.get(LOADED[tag]):
            self.loads.append(given[LOADED[tag]] or "")


def dead_links(site: Path) -> list[str]:
    """Every link and every load that leads nowhere or, of loads, out of the site."""
    pages = {
        file: Page(file.read_text(encoding="utf-8"))
        for file in site.rglob("*.html")
        if file.name != "recorded_helix.html"  # a page of the viewer, which its tests check
    }
    found = []
    for file, page in pages.items():
        where = file.relative_to(site)
        for target in page.links + page.loads:
            parts = urlsplit(target)
            if parts.scheme in ("http", "https", "data", "mailto") or parts.netloc:
                if target in page.loads and parts.scheme != "data":
                    found.append(f"{where}: {target} is loaded from elsewhere")
                continue
            to = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if not to.is_file():
                found.append(f"{where}: {target} is not there")
            elif parts.fragment and to in pages and parts.fragment not in pages[to].names:
                found.append(f"{where}: {target} has no such place")
    return found


def missing_names(site: Path) -> list[str]:
    """Every public name that is not described, or has no docstring."""
    with (site / "objects.inv").open("rb") as file:
        inventory = InventoryFile.load(file, "", lambda _, path: path)
    described = {name for kind, names in inventory.items() if kind[:3] == "py:" for name in names}
    found = []
    for name, thing in public_things().items():
        if name not in described:
            found.append(f"{name} is not described")
        if not inspect.getdoc(thing):
            found.append(f"{name} has no docstring")
    return found


def public_things() -> dict[str, object]:
    """What rcmqp and its packages export, under the name where it is defined."""
    modules = ["rcmqp", *(each.name for each in pkgutil.walk_packages(rcmqp.__path__, "rcmqp."))]
    found = {}
    for name in modules:
        if name.startswith(("rcmqp.cli", "rcmqp._kernel", "rcmqp.__main__")):
            continue
        module = importlib.import_module(name)
        for each in getattr(module, "__all__", []):
            thing = getattr(module, each)
            described = inspect.isclass(thing) or inspect.isfunction(thing)
            if described and thing.__module__.startswith("rcmqp."):
                found[f"{thing.__module__}.{thing.__qualname__}"] = thing
    return found


def main(folder: str) -> int:
    """Print what is wrong; 0 if nothing is."""
    site = Path(folder).resolve()
    wrong = dead_links(site) + missing_names(site)
    print("\n".join(wrong) or f"{len(public_things())} public names, no dead links")
    return min(1, len(wrong))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
