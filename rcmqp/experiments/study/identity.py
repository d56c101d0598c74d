"""What a trial depends on that its scenario and its law only name."""

from __future__ import annotations

import hashlib
import inspect
import json
import uuid
from pathlib import Path

from rcmqp.controllers import Controller
from rcmqp.experiments.kept import classes_outside
from rcmqp.runs.scenario import Scenario
from rcmqp.world.plugins import distributions_of


def identity(controller: Controller, scenario: Scenario) -> str:
    """SHA-256 over the URDF, the options as they are, and all code that is not rcmqp's own.

    Of controller, path, motion and plant that are not rcmqp's the code is known by the files that
    hold their classes, and a plug-in's by the version of its distribution too; rcmqp itself is
    known by its version. After a change of another file that they import, give the study another
    folder. A class that is in no file, such as one of a notebook, is never the same.
    """
    sha = hashlib.sha256(controller.insertion.arm.sha256.encode())
    sha.update(json.dumps(controller.options, sort_keys=True, default=str).encode())
    for kind in classes_outside(controller, scenario):
        sha.update(" ".join(distributions_of(kind)).encode())
        sha.update(_file_of(kind))
    return sha.hexdigest()


def _file_of(kind: type) -> bytes:
    """The content of the file that holds a class; new random bytes if it is in no file."""
    try:
        return Path(inspect.getfile(kind)).read_bytes()
    except (OSError, TypeError):
        return uuid.uuid4().bytes
