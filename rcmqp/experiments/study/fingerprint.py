"""What a trial depends on that its scenario and its law only name."""

from __future__ import annotations

import hashlib
import json
from types import CodeType

from rcmqp.controllers import Controller

PLAIN = (bool, int, float, str, tuple, type(None))


def fingerprint(controller: Controller) -> str:
    """SHA-256 over the URDF, the options as they are, and a controller of one's own.

    Of the latter what its class says, methods and numbers, and not what they call: whoever edits
    a function beside the class has to give the study another folder. rcmqp's own controllers
    are known by their version.
    """
    sha = hashlib.sha256(controller.insertion.arm.sha256.encode())
    sha.update(json.dumps(controller.options, sort_keys=True, default=str).encode())
    for kind in type(controller).__mro__:
        if kind is not object and kind.__module__.partition(".")[0] not in ("rcmqp", "abc"):
            for name, value in sorted(vars(kind).items()):
                sha.update(f"{name} {_told(value)}".encode())
    return sha.hexdigest()


def _told(value: object) -> str:
    """What there is to say of something in a class, the same in every process."""
    if isinstance(value, property):
        value = value.fget
    code = getattr(getattr(value, "__func__", value), "__code__", None)
    if isinstance(code, CodeType):
        return _code(code)
    return repr(value) if isinstance(value, PLAIN) else ""


def _code(code: CodeType) -> str:
    """A function's instructions, wherever it stands in its file."""
    constants = [
        _code(value) if isinstance(value, CodeType) else _constant(value)
        for value in code.co_consts
    ]
    return f"{code.co_code.hex()} {code.co_names} {code.co_varnames} {constants}"


def _constant(value: object) -> str:
    """A constant; the order of a set is another in every process."""
    return str(sorted(map(repr, value))) if isinstance(value, frozenset) else repr(value)
