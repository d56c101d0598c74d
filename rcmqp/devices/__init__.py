"""Haptic devices: from where a hand holds the handle to the view asked for.

Whatever reads a handle, a recorded trace, a model of an operator or a driver, gives a
DeviceState a cycle; a HandView makes a ViewCommand of each.
"""

from __future__ import annotations

from rcmqp.devices.clutch import Clutch
from rcmqp.devices.hand_view import HandView
from rcmqp.devices.mapping import HandMapping
from rcmqp.devices.omega7 import Encoder, Omega7
from rcmqp.devices.state import DeviceState

__all__ = ["Clutch", "DeviceState", "Encoder", "HandMapping", "HandView", "Omega7"]
