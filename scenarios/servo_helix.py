"""The helix on joints that lag, answer late and are read by encoders with noise.

One and a half turns of experiment A's helix, at its speed of 20 mm/s, in 10 s. The servo's
numbers are those of no particular arm, but of the usual order: a velocity loop of 5 ms, two
cycles of 1 ms from command to effect, encoders of 20 bits on the joint's side, which is 6 urad,
with 3 urad rms of noise; the measured velocity is filtered with 5 ms. The arm's own speed and
acceleration limits saturate it.
"""

from __future__ import annotations

from rcmqp import Scenario
from rcmqp.plants import Servo
from rcmqp.references.paths import ConicalHelix

SERVO = Servo(
    time_constant=5e-3,
    delay=2,
    counts_per_turn=2**20,
    noise=3e-6,
    velocity_filter=5e-3,
    velocity_saturation=True,
    acceleration_saturation=True,
)


def scenario(arm: str = "lwa3", *, flange: str | None = None) -> Scenario:
    """The helix from the arm's home, 10 to 12 cm inside."""
    path = ConicalHelix(turns=1.5, duration=10.0)
    return Scenario.on_shaft("servo_helix", arm, path, flange=flange, plant=SERVO)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
