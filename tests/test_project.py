"""What stands around the code: workflows, templates, the changelog and the paper."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import rcmqp

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
KINDS = ("Added", "Changed", "Deprecated", "Removed", "Fixed", "Security")
"""Of Keep a Changelog."""


def notes(version: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / ".github/release_notes.py"), version]
    return subprocess.run(command, capture_output=True, text=True)


def test_the_changelog_has_this_version_and_known_headings_only() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = re.findall(r"^## (\d+\.\d+\.\d+) - (?:unreleased|\d{4}-\d\d-\d\d)$", text, re.M)
    assert len(versions) == len(re.findall("^## ", text, re.M))
    assert versions == sorted(versions, reverse=True)
    assert rcmqp.__version__ in versions
    assert set(re.findall(r"^### (.*)$", text, re.M)) <= set(KINDS)


def test_the_citation_and_the_archive_have_this_version_and_licence() -> None:
    archive = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    assert (archive["version"], archive["license"]) == (rcmqp.__version__, PROJECT["license"])
    assert archive["keywords"] == PROJECT["keywords"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    for line in (f"version: {rcmqp.__version__}", f"license: {PROJECT['license']}"):
        assert f"\n{line}\n" in citation
    assert f'title: "{archive["title"]}"' in citation


def test_the_notes_of_a_release_are_its_part_of_the_changelog() -> None:
    found = notes("0.1.0").stdout
    assert "Scenarios `conical_helix` and `view_steps`" in found
    assert "rcmqp doctor" not in found
    assert "has no 9.9.9" in notes("9.9.9").stderr


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_is_yaml_and_what_it_runs_is_there(workflow: Path) -> None:
    yaml = pytest.importorskip("yaml")
    text = workflow.read_text(encoding="utf-8")
    found = yaml.safe_load(text)
    assert found["permissions"] == {"contents": "read"}
    assert all("runs-on" in job and "steps" in job for job in found["jobs"].values())
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    for line in re.findall(r"run: make (.*)", text):
        assert set(line.split()) <= targets
    for file in re.findall(r"(\.ci/\w+|\.github/\w+\.py)", text):
        assert (ROOT / file).is_file()


def test_workflows_test_every_python_that_the_package_names() -> None:
    named = set(re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"])))
    tested = (ROOT / ".github/workflows/tests.yml").read_text(encoding="utf-8")
    matrix = re.search(r"python: \[(.*)\]", tested)
    assert matrix
    assert set(re.findall(r"3\.\d+", matrix[1])) == named
    wheels = (ROOT / ".github/workflows/wheels.yml").read_text(encoding="utf-8")
    assert {f"3.{minor}" for minor in re.findall(r"cp3(\d+)-", wheels)} == named
    assert min(named, key=lambda x: int(x[2:])) == PROJECT["requires-python"].removeprefix(">=")


def test_the_paper_cites_what_its_bibliography_has() -> None:
    text = (ROOT / "paper/paper.md").read_text(encoding="utf-8")
    bibliography = (ROOT / "paper/paper.bib").read_text(encoding="utf-8")
    cited = set(re.findall(r"@([a-z]+\d*)", text))
    assert len(cited) > 8
    assert cited == set(re.findall(r"^@\w+\{(\w+),", bibliography, re.M))
    for part in ("Summary", "Statement of need", "State of the field", "Design", "Limits"):
        assert f"\n# {part}\n" in text


@pytest.mark.parametrize("name", ["CODE_OF_CONDUCT", "SECURITY", "SUPPORT", "CONTRIBUTING"])
def test_a_page_of_the_project_names_no_file_that_is_not_there(name: str) -> None:
    text = (ROOT / f"{name}.md").read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert target.startswith("https://") or (ROOT / target).exists(), target


@pytest.mark.parametrize("module", ["rcmqp.cli", "typer", "pinocchio"])
def test_ctrl_c_while_the_command_line_is_imported_shows_no_traceback(module: str) -> None:
    code = f"""
import runpy, sys
class Interrupt:
    def find_spec(self, name, *_):
        if name == {module!r}:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupt())
runpy.run_module("rcmqp", run_name="__main__")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")
