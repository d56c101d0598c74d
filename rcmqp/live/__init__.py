"""A live console: whoever has a browser steers an arm through a trocar. It needs rcmqp[live]."""
