"""The entry point of the command line: the program rcmqp, and python -m rcmqp."""

from __future__ import annotations

import sys


def main() -> None:
    """Import the command line and run it; Ctrl-C while it is imported shows no traceback."""
    try:
        from rcmqp.cli import main as run
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        raise SystemExit(130) from None
    run()


if __name__ == "__main__":
    main()
