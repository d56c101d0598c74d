"""Scenarios, their simulation, runs, their files and their metrics."""
