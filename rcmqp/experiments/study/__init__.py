"""Experiment B as a study: many operators, in parallel, with tables like the paper's."""
