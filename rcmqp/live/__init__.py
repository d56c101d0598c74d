"""A live console: steer an arm through a trocar from a browser. It needs rcmqp[live]."""

LOCAL = ("127.0.0.1", "localhost")
"""Names of the interface that only this machine reaches."""
