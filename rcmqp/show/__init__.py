"""Runs shown: figures, tables, the viewer's page and the report."""
