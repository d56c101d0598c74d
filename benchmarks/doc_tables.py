"""Make the tables of docs/ again: each from the command in the comment above it.

    <!-- comparison/comparison.md, table 1: rcmqp compare -s fast_helix -a lwa3 -->

says that the command, run in an empty folder, writes comparison/comparison.md, whose first table,
with the paragraph above it and the notes below it, is what follows. `make tables` runs every
command once, writes the tables into the documents and, with the kernel that made them, into
results/doc_tables.json.
tests/test_doc_tables.py runs the commands that are quick and compares the rest with that file.
"""

from __future__ import annotations

import hashlib
import json
import re
import resource
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rcmqp

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted((ROOT / "docs").glob("*.md"))
RESULTS = ROOT / "benchmarks" / "results" / "doc_tables.json"
MARKED = re.compile(
    r"<!-- (?P<file>\S+), table (?P<number>\d+): (?P<command>.+) -->\n\n"
    r"(?P<text>(?:(?:[^|<#\n].*\n\n)?(?:\|.*\n)+(?:\n(?:- .*\n)+)?)?)"
)
TABLE = re.compile(r"(?:^[^|<#\n].*\n\n)?(?:^\|.*\n)+(?:\n(?:^- .*\n)+)?", re.MULTILINE)


@dataclass(frozen=True)
class Marked:
    """A table in a document.

    Attributes:
        document: where it stands.
        file, number: which table of which file it is, counted from 1.
        command: that writes the file.
        text: what stands in the document: the table, a paragraph above it and notes below it.
    """

    document: Path
    file: str
    number: int
    command: str
    text: str

    @property
    def name(self) -> str:
        """Of the table, for one command."""
        return f"{self.file}, table {self.number}"


def marked() -> Iterator[Marked]:
    """Every marked table of the documents."""
    for document in DOCUMENTS:
        for found in MARKED.finditer(document.read_text(encoding="utf-8")):
            file, number, command, text = found.groups()
            yield Marked(document, file, int(number), command, text)


def tables_in(folder: Path) -> dict[str, list[str]]:
    """The tables of all Markdown files in a folder, by the files' names in it."""
    return {
        str(file.relative_to(folder)): TABLE.findall(file.read_text(encoding="utf-8"))
        for file in sorted(folder.rglob("*.md"))
    }


def kernel() -> str:
    """SHA-256 of the compiled core's sources."""
    sha = hashlib.sha256()
    for file in sorted((ROOT / "rcmqp" / "kernel").iterdir()):
        sha.update(file.name.encode() + file.read_bytes())
    return sha.hexdigest()


def run(command: str) -> dict[str, Any]:
    """Run a command in a folder of its own: its tables that are marked, and what made them."""
    program, *arguments = shlex.split(command)
    assert program == "rcmqp", command
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    with tempfile.TemporaryDirectory() as folder:
        done = [sys.executable, "-m", "rcmqp", *arguments]
        subprocess.run(done, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        tables = tables_in(Path(folder))
    seconds = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    made_by = {"rcmqp": rcmqp.__version__, "kernel": kernel(), "seconds": round(seconds)}
    texts = {x.name: tables[x.file][x.number - 1] for x in marked() if x.command == command}
    return {**made_by, "tables": texts}


def main() -> None:
    """Run all commands, or those with a word of the command line in them."""
    words = sys.argv[1:]
    results = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    commands = dict.fromkeys(each.command for each in marked())
    for command in commands:
        if not words or any(word in command for word in words):
            results[command] = run(command)
            print(f"{results[command]['seconds']:4d} s  {command}", flush=True)
    results = {command: results[command] for command in commands}
    RESULTS.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")

    def again(found: re.Match[str]) -> str:
        file, number, command, text = found.groups()
        new: str = results[command]["tables"][f"{file}, table {number}"]
        return found[0].removesuffix(text) + new + ("" if text else "\n")

    for document in DOCUMENTS:
        before = document.read_text(encoding="utf-8")
        document.write_text(MARKED.sub(again, before), encoding="utf-8")


if __name__ == "__main__":
    main()
