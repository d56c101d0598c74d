"""Experiment B with people: the task, the questions, and what is kept of each participant."""
