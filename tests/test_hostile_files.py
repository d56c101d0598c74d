"""Files with any value at any key: loaded, or refused in a sentence that names the file."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest
from test_arm_file import HOME
from test_urdf import urdf

from rcmqp import load_arm
from rcmqp.errors import RcmqpError
from rcmqp.world.arm_file import KEYS
from rcmqp.world.instrument_file import load_instrument
from rcmqp.world.recorded import Recorded

MOST_SIGNS = 2500
"""Of a sentence for people."""

HUGE = f"1{'0' * 400}"
VALUES = (
    *("0", "-1", "1e308", "1e400", "nan", "-inf", HUGE, f"-{HUGE}", "true", "2020-01-01"),
    *('"x"', r'"\u001b[31m"', r'"\u0000"', '"/dev/zero"', f'"{"x" * 500}"'),
    *("[]", "[[]]", "[1, 2]", "[1e308, 1e308, 1e308]", f"[{HUGE}, 0, 0]", '["a", "b", "c"]'),
    *("{}", "{ j1 = 1 }", "{ j1 = nan }", "{ j1 = [2, 1] }", '{ "\\u001b" = 1 }', "{ nope = 1 }"),
)

RAIL = {"axis": "[0, 1, 0]", "lower": "-0.2", "upper": "0.5", "velocity": "0.3"}
JOINT = {"name": '"a"', "axis": "[0, 0, 1]", "position": "[-1, 1]", "velocity": "1"}


def answered(call: Callable[[], object], file: str) -> None:
    """Nothing, or an error of rcmqp's that names the file and cannot reach the terminal."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            call()
        except RcmqpError as error:
            said = str(error)
            assert file in said
            assert len(said) < MOST_SIGNS


def table(entries: dict[str, str]) -> str:
    return "".join(f"{key} = {value}\n" for key, value in entries.items())


@pytest.mark.parametrize("key", [key for key in KEYS[""] if key not in KEYS])
def test_any_value_of_an_arms_file(tmp_path: Path, key: str) -> None:
    (tmp_path / "r.urdf").write_text(urdf())
    for value in VALUES:
        top = {"urdf": '"r.urdf"', "home": str(list(HOME)), key: value}
        if key == "like":
            del top["urdf"]
        (tmp_path / "bad.toml").write_text(f'{table(top)}[flange]\nframe = "l7"\n')
        answered(lambda: load_arm(tmp_path / "bad.toml"), "bad.toml")


@pytest.mark.parametrize(
    "key", [f"{table}.{key}" for table in ("flange", "base", "rail") for key in KEYS[table]]
)
def test_any_value_in_a_table_of_an_arms_file(tmp_path: Path, key: str) -> None:
    (tmp_path / "r.urdf").write_text(urdf())
    name, _, key = key.partition(".")
    for value in VALUES:
        tables = {"flange": {"frame": '"l7"'}, "base": {}, "rail": RAIL if name == "rail" else {}}
        text = f'urdf = "r.urdf"\nhome = {[*HOME, *[0.0] * (name == "rail")]}\n'
        for each, entries in tables.items():
            own = {**entries, key: value} if each == name else entries
            text += f"[{each}]\n{table(own)}" if own else ""
        (tmp_path / "bad.toml").write_text(text)
        answered(lambda: load_arm(tmp_path / "bad.toml"), "bad.toml")


@pytest.mark.parametrize(
    "key",
    [
        *("length", "radius", "mount_offset", "camera", "mount", "wrist", "camera.angle"),
        *("camera.field_of_view", "mount.xyz", "mount.rpy", "wrist.tool", "wrist.joints"),
        *("wrist.urdf", *(f"joint.{key}" for key in (*JOINT, "along", "jerk"))),
    ],
)
def test_any_value_of_an_instruments_file(tmp_path: Path, key: str) -> None:
    name, _, inside = key.rpartition(".")
    for value in VALUES:
        text = f"{key} = {value}\n"
        if name == "joint":
            text = f"[[wrist.joints]]\n{table({**JOINT, inside: value})}"
        elif name == "wrist" and inside == "urdf":
            text = f'[wrist]\nurdf = {value}\nshaft = "l1"\ntip = "l7"\n'
        elif name:
            text = f"[{name}]\n{inside} = {value}\n"
        (tmp_path / "bad.toml").write_text(text)
        answered(lambda: load_instrument(tmp_path / "bad.toml"), "bad.toml")


READERS: dict[str, Callable[[Path], object]] = {
    ".urdf": lambda path: load_arm(path, "l7"),
    ".xml": lambda path: load_arm(path, "l7"),
    ".gz": lambda path: load_arm(path, "l7"),
    ".xacro": lambda path: load_arm(path, "l7"),
    ".toml": load_arm,
    ".csv": Recorded.read,
    ".instrument": load_instrument,
}


@pytest.mark.parametrize("ending", READERS)
def test_anything_in_place_of_a_file(tmp_path: Path, ending: str) -> None:
    file = tmp_path / f"bad{ending}"
    for raw in (
        *(
            b"",
            b"\0",
            b"\x89PNG\r\n",
            b"PK\x03\x04xxxx",
            b"{}",
            b"<html></html>",
            b"\xff\xfe\x00a",
        ),
        *(urdf().encode("utf-16")[:-1], urdf().encode()[:300], b"<a>" * 50_000, b"a = 1\n" * 9),
        b'<?xml version="1.0" encoding="klingon"?><robot name="r"/>',
    ):
        file.write_bytes(raw)
        answered(lambda: READERS[ending](file), file.name)
    for target in (file, tmp_path, tmp_path / "gone", Path("/dev/zero")):
        file.unlink()
        file.symlink_to(target)
        with pytest.raises(RcmqpError, match=re.escape(file.name)):
            READERS[ending](file)
    file.unlink()
    os.mkfifo(file)  # nobody writes to it
    with pytest.raises(RcmqpError, match=re.escape(file.name)):
        READERS[ending](file)
