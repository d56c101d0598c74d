"""Many runs: comparisons, the paper's experiment A, and studies."""
