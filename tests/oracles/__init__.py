"""What compiled code computes, written again in numpy, to test it against."""
