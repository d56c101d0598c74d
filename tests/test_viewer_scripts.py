"""The page's scripts outside a browser: their own tests in Node.js, and how they become one."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from rcmqp.show.viewer.build import asset
from rcmqp.show.viewer.bundle import bundled

TESTS = sorted((Path(__file__).parent / "viewer").glob("*.test.js"))


@pytest.fixture(scope="module")
def node() -> str:
    path = shutil.which("node")
    if path is None:
        pytest.fail("Node.js 20 or newer is needed for the viewer's tests: apt-get install nodejs")
    return path


def ran(*command: str | Path) -> tuple[int, str]:
    """Exit code of a command, and what it wrote."""
    pipe, both = subprocess.PIPE, subprocess.STDOUT
    done = subprocess.run(command, stdout=pipe, stderr=both, text=True, check=False)
    return done.returncode, done.stdout


def bundle(**modules: str) -> str:
    """The bundle of modules by name; main comes last."""
    return bundled("main.js", lambda name: modules[name.removesuffix(".js")])


@pytest.mark.parametrize("file", TESTS, ids=lambda file: file.name)
def test_the_scripts_own_tests_pass(node: str, file: Path) -> None:
    code, said = ran(node, "--test", "--test-reporter=tap", file)
    assert code == 0, said
    assert "# pass 0" not in said


@pytest.mark.parametrize("entry", ["player.js", "live.js"])
def test_the_bundle_is_one_valid_module(node: str, tmp_path: Path, entry: str) -> None:
    file = tmp_path / "bundle.mjs"
    file.write_text(bundled(entry, asset), encoding="utf-8")
    code, said = ran(node, "--check", file)  # two modules may not use one name
    assert code == 0, said


def test_a_bundle_runs_as_its_modules_do(node: str, tmp_path: Path) -> None:
    modules = {
        "first": 'console.log("first");\n',
        "base": 'console.log("base");\nexport const two = 2;\nexport class Pair {}\n',
        "middle": 'import { two } from "./base.js";\nexport function four() { return 2 * two; }\n',
        "main": 'import "./first.js";\nimport {\n  two,\n} from "./base.js";\n'
        'import { four } from "./middle.js";\nconsole.log(two, four());\n',
    }
    for name, text in modules.items():
        (tmp_path / f"{name}.js").write_text(text)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "bundle.js").write_text(bundle(**modules))
    expected = ran(node, tmp_path / "main.js")
    assert expected == (0, "first\nbase\n2 4\n")
    assert ran(node, tmp_path / "bundle.js") == expected


@pytest.mark.parametrize(
    "line",
    [
        'import { a as b } from "./other.js";',
        'import * as other from "./other.js";',
        'import other from "./other.js";',
        "export default 1;",
        "export let a = 1;",
        'export { a } from "./other.js";',
    ],
)
def test_what_cannot_be_bundled_is_refused(line: str) -> None:
    with pytest.raises(ValueError, match=r"main\.js cannot be bundled: (import|export)") as caught:
        bundle(main=f"const x = 1;\n{line}\n", other="export const a = 1;\n")
    assert line in str(caught.value)


def test_modules_that_import_each_other_are_refused() -> None:
    modules = {"a": 'import { b } from "./b.js";\n', "b": 'import { a } from "./a.js";\n'}
    with pytest.raises(ValueError, match=r"each other: main\.js > a\.js > b\.js > a\.js"):
        bundle(main='import { a } from "./a.js";\n', **modules)
