"""The tip of the instrument in the world."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

from rcmqp._kernel import Block
from rcmqp.tasks.base import CompiledTask, check_finite


@dataclass(frozen=True, eq=False)
class TipTask(CompiledTask):
    """Bring the tip to where the desired effector has it.

    With a = tip_depth e_z the tip in the effector's axes, the tip is p + R a, so

        e = (p + R a) - (p_d + R_d a),
        de/dt = R (nu - [a]x omega) - R_d (nu_d + omega_d x a).

    A tool with a wrist is where the wrist has it, p_t with R_t and nu_t, and is asked to be there
    too: then e = p_t - (p_d + R_d a), and R_t nu_t stands in place of R (nu - [a]x omega).

    Attributes:
        tip_depth: from the effector to the tip, along the shaft [m]; with a straight wrist.
    """

    name: ClassVar[str] = "tip"
    unit: ClassVar[str] = "m"

    tip_depth: float

    def __post_init__(self) -> None:
        """Check the options."""
        super().__post_init__()
        check_finite("tip_depth", self.tip_depth, "m")

    @functools.cached_property
    def block(self) -> Block:
        """Error (3,) [m], in the world's axes."""
        return Block("tip", tip_depth=self.tip_depth)
