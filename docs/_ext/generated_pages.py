"""Pages that are written from the code, so that they cannot go stale: into docs/generated/."""

from __future__ import annotations

import ast
import importlib
import inspect
import itertools
import pkgutil
import shutil
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import rcmqp
from rcmqp.cli import app as command_line
from rcmqp.runs.channels import CHANNELS
from rcmqp.runs.loading import load_scenario, scenario_module, scenario_names
from rcmqp.world.loading import load_arm

if TYPE_CHECKING:
    from sphinx.application import Sphinx

DOCS = Path(__file__).parents[1]
OUT = DOCS / "generated"
EXAMPLES = DOCS.parent / "examples"
ROBOTS = DOCS.parent / "robots"

NO_REFERENCE = ("rcmqp.cli", "rcmqp._kernel", "rcmqp.robots", "rcmqp.scenarios", "rcmqp.__main__")
"""Packages and modules without a page: their page is another one, or they are compiled."""


def setup(app: Sphinx) -> dict[str, Any]:
    """Write every page before Sphinx looks for them."""
    app.connect("builder-inited", lambda _: write_all())
    return {"parallel_read_safe": True}


def write_all() -> None:
    """Write every page."""
    shutil.rmtree(OUT, ignore_errors=True)
    (OUT / "api").mkdir(parents=True)
    (OUT / "run").mkdir()
    pages = {
        "gallery.md": gallery(),
        "command_line.md": command_line_page(),
        "channels.md": channels_table(),
        "scenarios.md": scenarios_page(),
        "arms.md": arms_page(),
        "public_names.md": public_names(),
    }
    rooms = dict.fromkeys(module.split(".")[1] for module in module_names())
    pages |= {f"api/{room}.md": room_page(room) for room in rooms}
    for name, text in pages.items():
        (OUT / name).write_text(text, encoding="utf-8")
    write_run(OUT / "run" / "recorded_helix.html")


def gallery() -> str:
    """Every example: its picture, its docstring, its code."""
    parts = ["# Gallery of examples", "", "Each script shows one idea. Run it like this:", ""]
    parts += ["```sh", "python examples/01_first_run.py", "```", ""]
    for script in sorted(EXAMPLES.glob("[0-9]*.py")):
        text = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
        title, _, about = text.partition("\n")
        picture = f"../gallery/{script.stem}.png"
        parts += [f"## {title.rstrip('.')}", "", about.strip(), ""]
        parts += [f"```{{image}} {picture}", f":alt: {title}", ":class: drawn", "```", ""]
        parts += [f"<details><summary>examples/{script.name}</summary>", ""]
        parts += [f"```{{literalinclude}} ../../examples/{script.name}", ":language: python"]
        parts += ["```", "", "</details>", ""]
    return "\n".join(parts)


def command_line_page() -> str:
    """Every command with its help, its arguments and its options."""
    group = typer.main.get_group(command_line)
    context = group.context_class(group, info_name="rcmqp")
    parts = ["# Command line", "", "This page is written from the help of the command line.", ""]
    parts += [*_help(group.help or ""), ""]
    for name, command in group.commands.items():
        inner = command.context_class(command, info_name=name, parent=context)
        records = [each.get_help_record(inner) for each in command.get_params(inner)]
        rows = [(f"`{option}`", _cell(about)) for option, about in filter(None, records)]
        parts += [f"## rcmqp {name}", "", *_help(command.help or ""), ""]
        parts += [table(("argument or option", "what it is"), rows, 2), ""]
    return "\n".join(parts)


def channels_table() -> str:
    """The datasets of a run's file."""
    rows = [
        (f"`{name}`", channel.unit, _cell(channel.meaning)) for name, channel in CHANNELS.items()
    ]
    return table(("dataset", "unit", "meaning"), rows, 3) + "\n"


def scenarios_page() -> str:
    """What every scenario says of itself."""
    parts = [
        "# Scenarios",
        "",
        "`rcmqp scenarios` lists them, and `rcmqp run NAME` runs one. Times are",
    ]
    parts += ["for the LWA3.", ""]
    for name in scenario_names():
        made = load_scenario(name)
        facts = f"{made.duration:g} s, path `{type(made.path).__name__}`, "
        facts += f"plant `{type(made.plant).__name__}`, trocar `{type(made.motion).__name__}`"
        title, _, about = (inspect.getdoc(scenario_module(name)) or "").partition("\n")
        parts += [f"## {name}", "", _cell(title), "", _cell(about.strip()), "", f"*{facts}.*", ""]
    return "\n".join(parts)


def arms_page() -> str:
    """Every arm: its numbers, and the source of each."""
    parts = ["# Arms", "", "`rcmqp arms` lists them. For a URDF of your own, see"]
    parts += ["[Use your own robot](../guides/my_robot.md). Limits that no source gives are"]
    parts += ["assumed, for simulation only, and marked.", ""]
    for name in (each.parent.name for each in sorted(ROBOTS.glob("*/robot.toml"))):
        arm = load_arm(name)
        entry = tomllib.loads((ROBOTS / name / "robot.toml").read_text(encoding="utf-8"))
        columns = (arm.lower, arm.upper, arm.velocity, arm.acceleration, arm.jerk)
        rows = [
            (f"`{joint}`", *(f"{column[i]:.4g}" for column in columns))
            for i, joint in enumerate(arm.joints)
        ]
        heads = ("joint", "lower [rad]", "upper [rad]", "speed [rad/s]")
        assumed = " and ".join(sorted(arm.assumed)) or "none"
        parts += [f"## {arm.title}", "", f"`{name}`: {arm.nv} joints, reach {arm.reach:.2f} m,"]
        parts += [f"licence {arm.licence}; limits assumed: {assumed}.", ""]
        parts += [table((*heads, "acceleration [rad/s²]", "jerk [rad/s³]"), rows), ""]
        parts += [f"- **{what}**: {_cell(source)}" for what, source in entry["sources"].items()]
        parts += [""]
    return "\n".join(parts)


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> str:
    """A table whose cells are Markdown already; the first columns are words."""
    rule = ["---"] * words + ["---:"] * (len(heads) - words)
    return "\n".join(f"| {' | '.join(row)} |" for row in (heads, rule, *rows))


def public_names() -> str:
    """What ``import rcmqp`` gives, and where each is described."""
    rows = []
    for name in rcmqp.__all__:
        thing = getattr(rcmqp, name)
        if not hasattr(thing, "__qualname__"):
            thing = type(thing)  # a registry
        role = "class" if inspect.isclass(thing) else "func"
        if inspect.isclass(thing) and issubclass(thing, Exception):
            role = "exc"
        first = (inspect.getdoc(thing) or "").partition("\n")[0]
        link = f"{{py:{role}}}`{name} <{thing.__module__}.{thing.__qualname__}>`"
        rows.append((link, _cell(first)))
    return table(("name", "what it is"), rows, 2) + "\n"


def module_names() -> list[str]:
    """Every module with a page, packages before what is in them."""
    found = [
        module.name
        for module in pkgutil.walk_packages(rcmqp.__path__, "rcmqp.")
        if not module.name.startswith(NO_REFERENCE)
    ]
    return sorted(found)


def room_page(room: str) -> str:
    """One room of the package: every module in it, by autodoc."""
    parts = [f"# rcmqp.{room}", ""]
    for name in module_names():
        if name.split(".")[1] != room:
            continue
        if name != f"rcmqp.{room}":
            parts += [f"## {name.removeprefix('rcmqp.')}", ""]
        links = exported(name)
        parts += ["```{eval-rst}", f".. automodule:: {name}"]
        parts += [f"   :exclude-members: {', '.join(links)}", "```", ""]
        if links:
            parts += [f"Also in `{name}`: {', '.join(links.values())}.", ""]
    return "\n".join(parts)


def exported(name: str) -> dict[str, str]:
    """Links to what a module exports that is described where it is defined."""
    module = importlib.import_module(name)
    things = {each: getattr(module, each) for each in getattr(module, "__all__", [])}
    return {
        each: f"{{py:obj}}`{each} <{thing.__module__}.{thing.__qualname__}>`"
        for each, thing in things.items()
        if hasattr(thing, "__qualname__") and thing.__module__ != name
    }


def write_run(file: Path) -> None:
    """The page of a recorded run, to look at on the site."""
    from rcmqp.show.viewer import write_page

    scenario = rcmqp.load_scenario("conical_helix", period=0.008)
    runs = [
        rcmqp.simulate(scenario, rcmqp.make_controller(name, scenario.insertion(), 0.008))
        for name in ("dual_quaternion", "hierarchical_qp")
    ]
    write_page(runs, file)


def _help(text: str) -> Iterator[str]:
    """A command's help: paragraphs, and its examples as code."""
    paragraphs = (
        inspect.cleandoc(text).replace("[bold]", "`").replace("[/bold]", "`").split("\n\n")
    )
    for are_code, group in itertools.groupby(paragraphs, lambda text: text.startswith("  ")):
        if are_code:
            yield from ("```sh", *(text.strip() for text in group), "```", "")
        else:
            yield from itertools.chain.from_iterable((_words(text), "") for text in group)


def _words(text: str) -> str:
    """Plain text with `code` in it as Markdown."""
    parts = text.split("`")
    return "`".join(part if i % 2 else _cell(part) for i, part in enumerate(parts))


def _cell(text: str) -> str:
    """Plain text as Markdown."""
    for mark in "\\*_|[]<>$":
        text = text.replace(mark, f"\\{mark}")
    return text.replace("``", "`")
