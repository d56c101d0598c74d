"""python -m rcmqp is the command line."""

from rcmqp.cli import main

main()
