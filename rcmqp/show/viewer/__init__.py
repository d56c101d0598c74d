"""Recorded runs as a web page, as pictures and as video; the only place that imports meshcat."""

from rcmqp.show.viewer.build import page, write_page

__all__ = ["page", "write_page"]
