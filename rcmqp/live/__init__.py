"""A live console: steer an arm through a trocar from a browser. It needs rcmqp[live]."""
