"""Haptic devices: from where a hand holds the handle to the view asked for.

Whatever reads a handle, a recorded trace, a model of an operator or a driver, gives a
DeviceState a cycle; a HandView makes a ViewCommand of each.
"""

from __future__ import annotations

from rcmqp.references.hand.clutch import Clutch
from rcmqp.references.hand.hand_view import HandView
from rcmqp.references.hand.image_hand import ImageHand
from rcmqp.references.hand.mapping import HandMapping
from rcmqp.references.hand.state import DeviceState
from rcmqp.references.hand.viscous import Viscous

__all__ = ["Clutch", "DeviceState", "HandMapping", "HandView", "ImageHand", "Viscous"]
