"""Recorded runs as one report: tables, figures, viewers, and how to make it all again."""
